"""What stands in the title block of a drawing, beside what the map itself holds."""

from __future__ import annotations

from dataclasses import dataclass

PAPERS_MM = {"a4": (210.0, 297.0), "a3": (297.0, 420.0)}


@dataclass(frozen=True, slots=True)
class TitleBlock:
    """What a person enters, or the run knows."""

    title: str = "Floor plan"
    building: str = ""
    level: str = "0"  # as OpenStreetMap counts them
    date: str = ""
    bearing_rad: float | None = None  # of the robot's start heading, clockwise from north
    anchor_deg: tuple[float, float] | None = None  # latitude and longitude of the start (WGS 84)
    paper: str = "a4"  # of tiled pages

    @property
    def north_rad(self) -> float | None:
        """Where north is in the map, counter-clockwise from its x axis, which is the start heading."""
        return self.bearing_rad
