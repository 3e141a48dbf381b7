"""Photographs that Python packages ship, found without importing those: what stands behind signs, or holds none.

They show a garage, a cup, faces, a rocket, a palace, a flower, stones, walls, printed pages, coins, stars, an eye; none
a number plate.
"""

from __future__ import annotations

import importlib.util
from functools import cache
from pathlib import Path
from random import Random
from typing import cast

import cv2
import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]  # (height, width, 3), blue green red
PRINTED = ("page", "text")  # on these nothing is a plate
BACKDROPS = 7  # the first of them, behind half of the signs
SHARE_MIN = 0.35  # of a photograph's width, that a view shows
# The package's module, the folder in it, the names of the photographs
_FILES = (
    ("skimage", "data", ("motorcycle_left", "coffee", "astronaut", "chelsea", "brick", "gravel", "rocket", "camera",
                         "clock_motion", "coins", "grass", "hubble_deep_field", "moon", "page", "retina", "text")),
    ("sklearn", "datasets/images", ("china", "flower")),
)  # fmt: skip
_INSTALLED_AS = {"skimage": "scikit-image", "sklearn": "scikit-learn"}


def missing() -> list[str]:
    """Packages that would have to be installed for all photographs."""
    return [_INSTALLED_AS[package] for package, _, _ in _FILES if importlib.util.find_spec(package) is None]


@cache
def photographs(printed: bool = True) -> tuple[Image, ...]:
    """Those that are installed, with or without those of printed pages."""
    found = []
    for package, folder, names in _FILES:
        spec = importlib.util.find_spec(package)
        if spec is None or spec.origin is None:
            continue
        files = [
            Path(spec.origin).parent / folder / f"{name}{end}"
            for name in names
            if printed or name not in PRINTED
            for end in (".png", ".jpg")
        ]
        found += [np.asarray(cv2.imread(str(file)), np.uint8) for file in files if file.is_file()]
    return tuple(found)


def backdrop(rng: Random, size_px: tuple[int, int]) -> npt.NDArray[np.float32]:
    """One of the first photographs, so large that it fills a picture of that width and height."""
    photo = rng.choice(photographs()[:BACKDROPS])
    grown = max(size_px[0] / photo.shape[1], size_px[1] / photo.shape[0])
    large = cv2.resize(photo, None, fx=grown, fy=grown, interpolation=cv2.INTER_CUBIC)
    return np.asarray(large[: size_px[1], : size_px[0]], np.float32)


def view(rng: Random, size_px: tuple[int, int], printed: bool = True) -> npt.NDArray[np.float32]:
    """A part of one photograph that fills a picture of that width and height."""
    photo = rng.choice(photographs(printed))
    height, width = photo.shape[:2]
    shown = rng.uniform(SHARE_MIN, 1.0) * min(width, height * size_px[0] / size_px[1])
    wide, high = int(shown), int(shown * size_px[1] / size_px[0])
    left, top = rng.randint(0, width - wide), rng.randint(0, height - high)
    part = photo[top : top + high, left : left + wide]
    return cast("npt.NDArray[np.float32]", cv2.resize(part, size_px, interpolation=cv2.INTER_CUBIC).astype(np.float32))
