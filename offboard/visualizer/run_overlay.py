"""Another recorded run over the one that a page shows: two run folders -> coloured walls for the page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from common.geometry import Points
from offboard.evaluate.map_difference import map_difference, seen_of
from offboard.export import occupancy_image
from offboard.runs.run_folder import read_map


@dataclass(frozen=True, slots=True)
class RunOverlay:
    here: Path
    there: Path

    @property
    def name(self) -> str:
        return self.there.resolve().name

    def layers(self) -> dict[str, Any]:
        """Walls as x, y, x, y ... by what they are, and a sentence. Raises StartError for a run that cannot be read."""
        here_m, there_m = (read_map(run).points_m for run in (self.here, self.there))
        seen_here, seen_there = (seen_of(occupancy_image.image_of_run(run)) for run in (self.here, self.there))
        found = map_difference(here_m, there_m, seen_here, seen_there)
        layers = {
            "common": found.common_m,
            "here": found.only_here_m,
            "there": found.only_there_m,
            "unseen": found.unseen_m,
        }
        return {"text": found.as_text(), "layers": {name: _flat(points_m) for name, points_m in layers.items()}}


def _flat(points_m: Points) -> list[float]:
    return [round(value, 2) for value in points_m.ravel().tolist()]
