"""Where doors are on the walls: edges by colour, jambs by lines, handles and the map in, pairs of edges out.

What tells a door is put together here, since each alone fails somewhere: a colour that parts it from its wall, jambs
that run up above what hangs on walls, lines on both sides of their frame, a lintel, a handle, wall behind it or, where
it stands open, on both sides of it. Pure.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

from onboard.poi.doors.door_detection import Side
from onboard.poi.doors.observations import Edge, Jamb, Place, same_wall
from onboard.poi.placement.wall_line import WallPoint

OFF_WALL_M = 0.25  # between what belongs to one wall, out of its plane
DOOR_WIDTH_M = (0.65, 1.45)  # between the outer edges of the frame
OPEN_WIDTH_M = 1.2  # of a door without wall behind it: wider ones are mouths of side halls
FLANK_M = (0.08, 0.4)  # from the edge of an open door: there is wall
JAMBS_MIN = 2  # observations of a jamb: one alone is often noise
NEAR_M = 0.12  # between a jamb and the edge by colour that is the same
HANDLE_INSET_M = (0.03, 0.28)  # of the middle of a handle from the jamb that it is near to
HANDLES_MIN = 2  # observations
HANDLES_MAX = 2  # of one door
DOUBLED_MIN = 0.4  # share of the observations of a jamb that show both sides of it
CROSSED_BOTH, CROSSED_ONE = 0.5, 0.75  # share of the looks at a jamb in which a line leads away, less those without
ALIKE_M = 0.025  # between the widths of the jambs of one frame
HANDLE_VOTES = 2  # of a handle, which nothing but doors has; every other cue has one
VOTES_MIN = 3  # of a door without a plate

Backed = Callable[[WallPoint, WallPoint], bool]
Ranked = tuple[float, float, int, int]  # what orders pairs, and the two ends of one by index


@dataclass(frozen=True, slots=True)
class Span:
    """Left and right edge of a door. `sure`: they look like a door's even where no plate is near."""

    left: Edge
    right: Edge
    sure: bool

    @property
    def ends(self) -> tuple[WallPoint, WallPoint]:
        return self.left.place.point, self.right.place.point


def door_spans(edges: list[Edge], jambs: list[Jamb], handles: list[Place], backed: Backed) -> list[Span]:
    """All doors: those by colour, and between them those by lines. `backed`: is there wall between two points?"""
    jambs = [jamb for jamb in jambs if jamb.place.count >= JAMBS_MIN]
    by_colour = [
        Span(left, right, sure)
        for left, right in _pairs(edges)
        if _may_be_door(left.place.point, right.place.point, backed)
        and ((sure := _looks_like_door(left, right, jambs, backed)) or not _parted(left, right, jambs))
    ]
    # Edges by colour are placed more exactly; a door that only lines are sure of is none by colour
    spans: list[Span] = []
    for span in sorted(by_colour + _by_lines(edges, jambs, handles, backed), key=lambda span: not span.sure):
        if not any(_overlap(span, other) for other in spans):
            spans.append(span)
    return spans


def _pairs(edges: list[Edge]) -> list[tuple[Edge, Edge]]:
    """Pairs of a left and a right edge that are a door, the best observed first, then the widest; each edge once."""
    pairs: list[Ranked] = []
    for i, left in enumerate(edges):
        if left.side is not Side.LEFT:
            continue
        for j, right in enumerate(edges):
            a, b = left.place.point, right.place.point
            if right.side is Side.RIGHT and _as_far_as_jambs(a, b):
                pairs.append((-min(left.place.count, right.place.count), -b.right_of(a), i, j))
    return [(edges[i], edges[j]) for _, _, i, j in _each_once(pairs)]


def _as_far_as_jambs(a: WallPoint, b: WallPoint) -> bool:
    """Whether two points of a wall are as far apart as the left and right end of a door."""
    return same_wall(a, b) and DOOR_WIDTH_M[0] <= b.right_of(a) <= DOOR_WIDTH_M[1] and b.off(a) < OFF_WALL_M


def _each_once(ranked: list[Ranked]) -> list[Ranked]:
    """The first in order, without those of which an end was taken before."""
    used: set[int] = set()
    kept = []
    for one in sorted(ranked):
        ends = {one[2], one[3]}
        if not ends & used:
            used |= ends
            kept.append(one)
    return kept


def _looks_like_door(left: Edge, right: Edge, jambs: list[Jamb], backed: Backed) -> bool:
    """Whether edges by colour are a door's, and not those of a board or window.

    They run through the whole picture, or are known to rise above what hangs on walls, and no sill leads across.
    """
    ends = [[jamb for jamb in jambs if same_place(jamb.place, edge.place)] for edge in (left, right)]
    rising = min(left.rising, right.rising) > 0
    if not rising and not all(ends):
        return False
    a, b = left.place.point, right.place.point
    return not (backed(a, b) and any(_crossed(*pair) for pair in product(*ends)))


def _parted(left: Edge, right: Edge, jambs: list[Jamb]) -> bool:
    """Whether a jamb between two edges was observed more often than both: they are not ends of one door."""
    a, b = left.place.point, right.place.point
    return any(
        jamb.place.count > max(left.place.count, right.place.count)
        and _near(left.place, jamb.place)
        and same_wall(a, at := jamb.place.point)
        and at.off(a) < OFF_WALL_M
        and min(at.right_of(a), b.right_of(at)) > NEAR_M
        for jamb in jambs
    )


def same_place(a: Place, b: Place) -> bool:
    """Whether an edge by colour and a jamb by lines are one."""
    return _near(a, b) and same_wall(a.point, b.point) and a.point.distance_m(b.point) < NEAR_M


def _may_be_door(a: WallPoint, b: WallPoint, backed: Backed) -> bool:
    return backed(a, b) or _is_open(a, b, backed)


def _is_open(a: WallPoint, b: WallPoint, backed: Backed) -> bool:
    """No wider than a door, and with wall on both sides."""
    if b.right_of(a) > OPEN_WIDTH_M:
        return False
    near, far = FLANK_M
    return backed(a.moved_right(-far), a.moved_right(-near)) and backed(b.moved_right(near), b.moved_right(far))


def _by_lines(edges: list[Edge], jambs: list[Jamb], handles: list[Place], backed: Backed) -> list[Span]:
    """Pairs of jambs, those that most speaks for first; each jamb once."""
    found: list[Ranked] = []
    for i, left in enumerate(jambs):
        for j, right in enumerate(jambs):
            if i == j or not _near(left.place, right.place):
                continue
            a, b = left.place.point, right.place.point
            if not _as_far_as_jambs(a, b):
                continue
            closed = backed(a, b)
            if (closed and _crossed(left, right)) or not (closed or _is_open(a, b, backed)):
                continue
            votes = _votes(left, right, edges) + (HANDLE_VOTES if _has_handle(a, b, handles) else 0)
            found.append((-votes, -min(left.place.count, right.place.count), i, j))
    spans = []
    for less_votes, _, i, j in _each_once(found):
        left, right = jambs[i], jambs[j]
        # From near by no picture reaches so high that a jamb could rise above anything
        needed = VOTES_MIN if left.risen or right.risen else VOTES_MIN - 1
        spans.append(Span(_edge(Side.LEFT, left), _edge(Side.RIGHT, right), -less_votes >= needed))
    return spans


def _edge(side: Side, jamb: Jamb) -> Edge:
    return Edge(side, jamb.place, jamb.risen)


def _crossed(left: Jamb, right: Jamb) -> bool:
    """A sill or a rim leads from one jamb to the other; what is seen through glass does so now and then."""
    shares = [jamb.crossed[inwards] / jamb.place.count for jamb, inwards in ((left, Side.RIGHT), (right, Side.LEFT))]
    return min(shares) >= CROSSED_BOTH or max(shares) >= CROSSED_ONE


def _near(a: Place, b: Place) -> bool:
    """Cheap: most jambs of a floor are far from each other."""
    return abs(a.x_m - b.x_m) <= DOOR_WIDTH_M[1] and abs(a.y_m - b.y_m) <= DOOR_WIDTH_M[1]


def _votes(left: Jamb, right: Jamb, edges: list[Edge]) -> int:
    """How many cues both jambs share, and those of colour."""
    risen = min(left.risen, right.risen) >= JAMBS_MIN
    doubled = all(jamb.doubled >= DOUBLED_MIN * jamb.place.count for jamb in (left, right))
    alike = doubled and abs(left.width_m - right.width_m) < ALIKE_M
    capped = left.capped[Side.RIGHT] > 0 and right.capped[Side.LEFT] > 0
    colour = [
        any(edge.side is side and same_place(edge.place, jamb.place) for edge in edges)
        for side, jamb in ((Side.LEFT, left), (Side.RIGHT, right))
    ]
    return sum((risen, doubled, alike, capped, *colour))


def _has_handle(a: WallPoint, b: WallPoint, handles: list[Place]) -> bool:
    """Whether a handle is near to one of two jambs, and not one of many things between them: then it is furniture."""
    insets_m = [
        min(at.right_of(a), b.right_of(at))
        for handle in handles
        if handle.count >= HANDLES_MIN and same_wall(a, at := handle.point) and at.off(a) <= OFF_WALL_M
    ]
    between = [inset_m for inset_m in insets_m if inset_m > 0.0]
    return len(between) <= HANDLES_MAX and any(HANDLE_INSET_M[0] <= v <= HANDLE_INSET_M[1] for v in between)


def _overlap(span: Span, other: Span) -> bool:
    (a, b), (c, d) = span.ends, other.ends
    if not same_wall(a, c) or a.off(c) > OFF_WALL_M:
        return False
    return max(0.0, a.right_of(c)) < min(b.right_of(c), d.right_of(c))
