"""A picture with its time: what cameras hand over and the POI module works on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]  # (height, width, 3), blue green red
Gray = npt.NDArray[np.uint8]  # (height, width)

PREVIEW_SIZE_PX = (640, 480)
FULL_SIZE_PX = (1280, 960)
PREVIEW_PERIOD_S = 0.4  # a door of 0.9 m is in 14 previews at mapping speed


@dataclass(frozen=True, slots=True)
class Frame:
    """A picture and when it was taken, on the clock of the node."""

    t_s: float
    image: Image
