"""All edges and signs of the floor: single observations in, doors out.

An observation near an earlier one of its kind is merged with it (nearest neighbour within a gate). Pure: the node
decides when it publishes a door and when it requests another photo.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

from onboard.poi.doors.door_association import Door, associated
from onboard.poi.doors.door_detection import Side
from onboard.poi.doors.hall_order import out_of_order
from onboard.poi.doors.jamb_lines import JambView
from onboard.poi.doors.observations import NUMBERED, Edge, Jamb, Place, Sign, move, same_wall
from onboard.poi.placement.map_shift import MapShift
from onboard.poi.placement.wall_line import WallPoint
from onboard.poi.signs.sign_reading import SignReading
from onboard.poi.signs.site_numbers import SiteNumbers

EDGE_GATE_M = 0.15  # between observations of one edge; doors stand further apart
HANDLE_GATE_M = 0.10
SIGN_GATE_M = 0.30  # between observations of one sign


class DoorRecords:
    """All edges and signs of the floor."""

    def __init__(self, backed: Callable[[WallPoint, WallPoint], bool], site: SiteNumbers) -> None:
        """`backed`: is there wall between a left and a right edge?"""
        self._backed = backed
        self.site = site
        self.edges: list[Edge] = []
        self.jambs: list[Jamb] = []
        self.handles: list[Place] = []
        self.signs: list[Sign] = []

    def add_edge(self, side: Side, point: WallPoint, now_s: float, rises: bool | None = None) -> None:
        """Takes an observation of an edge of a door; `rises`: as `DoorEdge` has it."""
        edge = _nearest([edge for edge in self.edges if edge.side is side], point, EDGE_GATE_M)
        if edge is not None:
            edge.place.add(point, now_s)
        else:
            edge = Edge(side, Place.of(point, now_s))
            self.edges.append(edge)
        edge.vote(rises)

    def add_jamb(self, view: JambView, point: WallPoint, now_s: float) -> None:
        """Takes an observation of a jamb by its lines."""
        jamb = _nearest(self.jambs, point, EDGE_GATE_M)
        if jamb is None:
            jamb = Jamb(Place.of(point, now_s))
            self.jambs.append(jamb)
        else:
            jamb.place.add(point, now_s)
        jamb.vote(view)

    def add_handle(self, point: WallPoint, now_s: float) -> None:
        """Takes an observation of what may be a door's handle."""
        near = [place for place in self.handles if same_wall(place.point, point)]
        handle = min(near, key=lambda place: place.point.distance_m(point), default=None)
        if handle is None or handle.point.distance_m(point) >= HANDLE_GATE_M:
            self.handles.append(Place.of(point, now_s))
        else:
            handle.add(point, now_s)

    def sign_at(self, point: WallPoint, others: Sequence[Sign] = (), key: str = "") -> Sign | None:
        """The sign that was observed at this point before, or None; not one of the `others`, rather one of that key."""
        free = [sign for sign in self.signs if not any(sign is other for other in others)]
        known = _nearest([sign for sign in free if key and key in sign.votes], point, SIGN_GATE_M)
        return known or _nearest(free, point, SIGN_GATE_M)

    def add_photo(self, seen: Sequence[tuple[WallPoint, SignReading, float]], now_s: float) -> list[Sign]:
        """Takes all signs that one photo shows, with place, reading and bearing; returns the merged signs.

        Plates with different numbers that are seen at once are different signs, however near they hang.
        """
        merged: dict[int, Sign] = {}
        taken: dict[str, Sign] = {}
        keys = [_key(reading) for _, reading, _ in seen]
        known = [self.sign_at(point, key=key) for (point, *_), key in zip(seen, keys, strict=True)]
        first = [sign is not None and key in sign.votes for sign, key in zip(known, keys, strict=True)]
        for i in sorted(range(len(seen)), key=lambda i: not first[i]):
            point, reading, bearing_rad = seen[i]
            others = [sign for key, sign in taken.items() if keys[i] and key != keys[i]]
            sign = merged[i] = self.add_sign(point, now_s, reading, bearing_rad, others)
            for other in others:  # while it was seen alone, it was taken for its neighbour
                if keys[i] in other.votes:
                    sign.votes[keys[i]].join(other.votes.pop(keys[i]))
            if keys[i]:
                taken[keys[i]] = sign
        return [merged[i] for i in range(len(seen))]

    def add_sign(
        self,
        point: WallPoint,
        now_s: float,
        reading: SignReading | None = None,
        bearing_rad: float = 0.0,
        others: Sequence[Sign] = (),
    ) -> Sign:
        """Takes an observation of a possible sign, with its reading where there is one; returns the merged sign.

        `bearing_rad`: direction from the sign to the robot that read it, on the map. `others`: which it is not.
        """
        sign = self.sign_at(point, others, _key(reading))
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

    def move(self, shift: MapShift) -> None:
        """Moves all that was observed with the map."""
        placed: list[_Placed] = [*self.edges, *self.jambs, *self.signs]
        move([*(one.place for one in placed), *self.handles], shift)

    def doors(self) -> list[Door]:
        """Doors with their plates, and plates that stand alone; judged and associated anew in every call."""
        self.site = self.site.after(s.read for s in self.signs if s.read is not None and s.agreed and not s.rejected)
        for sign in self.signs:
            sign.doubt = self.site.doubt(sign.read) if sign.read is not None else ""
        for sign in out_of_order([sign for sign in self.signs if sign.is_plate and sign.votes and not sign.doubt]):
            sign.doubt = "not in the order of its neighbours"
        return associated(self.edges, self.jambs, self.handles, self.signs, self._backed)


def _key(reading: SignReading | None) -> str:
    """The key of the number that a reading votes for, empty where it has none."""
    if reading is None or reading.number is None or reading.verdict not in NUMBERED:
        return ""
    return reading.number.key


class _Placed(Protocol):
    place: Place


P = TypeVar("P", bound=_Placed)


def _nearest(known: Sequence[P], point: WallPoint, gate_m: float) -> P | None:
    """What was observed on that wall nearest to a point, within the gate."""
    on_wall = [one for one in known if same_wall(one.place.point, point)]
    nearest = min(on_wall, key=lambda one: one.place.point.distance_m(point), default=None)
    return nearest if nearest is not None and nearest.place.point.distance_m(point) < gate_m else None
