"""What a person drew on the map: no-go lines and areas, and areas outside of which the robot must not be. Pure.

Messages <-> values, and plain geometry. The hull never touches a line or an area, and never leaves the union of the
areas to stay in, where there is one.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import accumulate, pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from common.fields import CORNERS_MAX
from common.geometry import FloatArray, Points
from common.messages.mission import Operation, OperatorCommand, Zones

REACH_M = 500.0  # from the start along both axes: no floor lies farther


class ZoneKind(Enum):
    """The value stands in messages and files."""

    LINE = "no-go-line"
    AREA = "no-go-area"
    ONLY = "only-here"

    @property
    def corners_min(self) -> int:
        return 2 if self is ZoneKind.LINE else 3


KIND_OF = {
    Operation.NO_GO_LINE: ZoneKind.LINE,
    Operation.NO_GO_AREA: ZoneKind.AREA,
    Operation.ONLY_HERE: ZoneKind.ONLY,
}
ZONE_OPERATIONS = (*KIND_OF, Operation.REMOVE_ZONE)
TITLES = {ZoneKind.LINE: "no-go line", ZoneKind.AREA: "no-go area", ZoneKind.ONLY: "area to stay in"}

Corner = tuple[float, float]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Zone:
    """Its corners in the map, in order (metres); those of an area are closed by their last side. `number` names it."""

    number: int
    kind: ZoneKind
    corners_m: tuple[Corner, ...]

    @property
    def sides(self) -> tuple[tuple[Corner, Corner], ...]:
        closed = self.corners_m if self.kind is ZoneKind.LINE else (*self.corners_m, self.corners_m[0])
        return tuple(pairwise(closed))

    @property
    def title(self) -> str:
        return f"{TITLES[self.kind]} {self.number}"


def problem_with(kind: ZoneKind, corners_m: Sequence[Corner]) -> str:
    """Why these corners make no such zone, as one sentence; empty where they do."""
    what = TITLES[kind]
    if not kind.corners_min <= len(set(corners_m)) <= len(corners_m) <= CORNERS_MAX:
        return f"A {what} has {kind.corners_min} to {CORNERS_MAX} different corners.".replace("A a", "An a")
    if not all(abs(metres) <= REACH_M for corner in corners_m for metres in corner):
        return f"A corner lies more than {REACH_M:.0f} m from the start."
    return ""


def corners_of(command: OperatorCommand) -> tuple[Corner, ...]:
    return tuple(zip(command.corners_x_m, command.corners_y_m, strict=True))


def zones_of(message: Zones) -> tuple[Zone, ...]:
    """Those that this program knows and that are sound."""
    ends = list(accumulate(message.corner_counts, initial=0))
    corners = list(zip(message.corners_x_m, message.corners_y_m, strict=True))
    kinds = {kind.value: kind for kind in ZoneKind}
    found = []
    for number, name, (start, end) in zip(message.numbers, message.kinds, pairwise(ends), strict=True):
        kind, part = kinds.get(name), tuple(corners[start:end])
        if kind is not None and not problem_with(kind, part):
            found.append(Zone(number, kind, part))
    return tuple(found)


def message_of(now_s: float, zones: Iterable[Zone]) -> Zones:
    each = tuple(zones)
    corners = [corner for zone in each for corner in zone.corners_m]
    return Zones(
        now_s,
        numbers=tuple(zone.number for zone in each),
        kinds=tuple(zone.kind.value for zone in each),
        corner_counts=tuple(len(zone.corners_m) for zone in each),
        corners_x_m=tuple(x_m for x_m, _ in corners),
        corners_y_m=tuple(y_m for _, y_m in corners),
    )


def as_json(zones: Iterable[Zone]) -> list[dict[str, Any]]:
    """As files hold them."""
    return [{"number": zone.number, "kind": zone.kind.value, "corners_m": zone.corners_m} for zone in zones]


def of_json(content: Any) -> tuple[Zone, ...]:
    """Raises ValueError with one sentence for what does not hold zones."""
    if not isinstance(content, list):
        raise ValueError("It must hold a list of lines and areas.")
    return tuple(_of_entry(entry) for entry in content)


def _of_entry(entry: Any) -> Zone:
    try:
        number, kind = entry["number"], ZoneKind(entry["kind"])
        corners_m = tuple((float(x_m), float(y_m)) for x_m, y_m in entry["corners_m"])
    except (ValueError, TypeError, KeyError, OverflowError) as error:
        raise ValueError("An entry is no line or area with its corners.") from error
    problem = problem_with(kind, corners_m)
    if problem or type(number) is not int or number < 1:
        raise ValueError(problem or "A line or area has no number.")
    return Zone(number, kind, corners_m)


def sides_of(zones: Iterable[Zone]) -> FloatArray:
    """(E, 4): x, y of both ends of every side."""
    return np.array([(*a, *b) for zone in zones for a, b in zone.sides], np.float64).reshape(-1, 4)


def keeps_out(zones: Sequence[Zone], points: Points) -> Mask:
    """(N,) which of the points (N, 2) lie in a no-go area, or outside of all areas to stay in."""
    out, inside_one, alone = np.zeros(len(points), bool), np.zeros(len(points), bool), False
    for zone in zones:
        if zone.kind is ZoneKind.AREA:
            out |= _inside(zone, points)
        elif zone.kind is ZoneKind.ONLY:
            inside_one |= _inside(zone, points)
            alone = True
    return out | ~inside_one if alone else out


def _inside(zone: Zone, points: Points) -> Mask:
    """By the even-odd rule."""
    x, y = points[:, 0], points[:, 1]
    odd = np.zeros(len(points), bool)
    for (x0, y0), (x1, y1) in zone.sides:
        if y0 != y1:
            spans = (y0 <= y) != (y1 <= y)
            odd ^= spans & (x < x0 + (y - y0) * ((x1 - x0) / (y1 - y0)))
    return odd


def gap_m(zones: Sequence[Zone], x_m: float, y_m: float) -> float:
    """From a place to where the zones keep the robot out (metres): 0 or less inside, infinite without zones."""
    sides = sides_of(zones)
    if not len(sides):
        return float("inf")
    point = np.array([[x_m, y_m]])
    start, along = sides[:, :2], sides[:, 2:] - sides[:, :2]
    length2 = np.maximum((along**2).sum(axis=1), 1e-12)
    share = np.clip(((point - start) * along).sum(axis=1) / length2, 0.0, 1.0)
    nearest = np.hypot(*(start + share[:, None] * along - point).T)
    counts = _bounds(zones, sides, start + share[:, None] * along)
    gap = float(nearest[counts].min(initial=np.inf))
    return -gap if bool(keeps_out(zones, point)[0]) else gap


def _bounds(zones: Sequence[Zone], sides: FloatArray, at: Points) -> Mask:
    """(E,) whether a side is a border there, at points (E, 2) on the sides: one between areas that touch is none."""
    of_line = np.array([zone.kind is ZoneKind.LINE for zone in zones for _ in zone.sides], bool)
    along = sides[:, 2:] - sides[:, :2]
    normal = np.column_stack([-along[:, 1], along[:, 0]]) / np.maximum(np.hypot(*along.T), 1e-12)[:, None]
    bounds: Mask = of_line | (keeps_out(zones, at + 1e-3 * normal) != keeps_out(zones, at - 1e-3 * normal))
    return bounds
