"""All edges and signs of the floor: single observations in, doors out.

An observation near an earlier one of its kind is merged with it (nearest neighbour within a gate). Pure: the node
decides when it publishes a door and when it requests another photo.
"""

from __future__ import annotations

from collections.abc import Callable

from onboard.poi.doors.door_association import Door, associated
from onboard.poi.doors.door_detection import Side
from onboard.poi.doors.hall_order import out_of_order
from onboard.poi.doors.observations import Edge, Place, Sign, same_wall
from onboard.poi.placement.wall_line import WallPoint
from onboard.poi.signs.sign_reading import SignReading
from onboard.poi.signs.site_numbers import SiteNumbers

EDGE_GATE_M = 0.15  # between observations of one edge; doors stand further apart
SIGN_GATE_M = 0.30  # between observations of one sign


class DoorRecords:
    """All edges and signs of the floor."""

    def __init__(self, backed: Callable[[WallPoint, WallPoint], bool], site: SiteNumbers) -> None:
        """`backed`: is there wall between a left and a right edge?"""
        self._backed = backed
        self.site = site
        self.edges: list[Edge] = []
        self.signs: list[Sign] = []

    def add_edge(self, side: Side, point: WallPoint, now_s: float, rises: bool | None = None) -> None:
        """Takes an observation of an edge of a door; `rises`: as `DoorEdge` has it."""
        near = [e for e in self.edges if e.side is side and same_wall(e.place.point, point)]
        edge = min(near, key=lambda e: e.place.point.distance_m(point), default=None)
        if edge is not None and edge.place.point.distance_m(point) < EDGE_GATE_M:
            edge.place.add(point, now_s)
        else:
            edge = Edge(side, Place.of(point, now_s))
            self.edges.append(edge)
        edge.vote(rises)

    def sign_at(self, point: WallPoint) -> Sign | None:
        """The sign that was observed at this point before, or None."""
        near = [s for s in self.signs if same_wall(s.place.point, point)]
        sign = min(near, key=lambda s: s.place.point.distance_m(point), default=None)
        return sign if sign is not None and sign.place.point.distance_m(point) < SIGN_GATE_M else None

    def add_sign(
        self, point: WallPoint, now_s: float, reading: SignReading | None = None, bearing_rad: float = 0.0
    ) -> Sign:
        """Takes an observation of a possible sign, with its reading where there is one; returns the merged sign.

        `bearing_rad`: direction from the sign to the robot that read it, on the map.
        """
        sign = self.sign_at(point)
        if sign is None:
            sign = Sign(Place.of(point, now_s))
            self.signs.append(sign)
        else:
            sign.place.add(point, now_s)
        if reading is not None:
            sign.vote(reading, bearing_rad)
        return sign

    def add_blank(self, point: WallPoint, now_s: float) -> None:
        """Takes a photo of a possible sign in which nothing was legible."""
        sign = self.sign_at(point)
        if sign is None:
            sign = self.add_sign(point, now_s)
        sign.blanks += 1

    def doors(self) -> list[Door]:
        """Doors with their plates, and plates that stand alone; judged and associated anew in every call."""
        self.site = self.site.after(s.read for s in self.signs if s.read is not None and s.agreed and not s.rejected)
        for sign in self.signs:
            sign.doubt = self.site.doubt(sign.read) if sign.read is not None else ""
        for sign in out_of_order([sign for sign in self.signs if sign.is_plate and sign.votes and not sign.doubt]):
            sign.doubt = "not in the order of its neighbours"
        return associated(self.edges, self.signs, self._backed)
