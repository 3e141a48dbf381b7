"""No-go lines and areas as a person types them: "line 1,2 3,4", "area ...", "only ...", "remove 3" -> order. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from common.messages.mission import Operation
from common.zones import KIND_OF, problem_with
from offboard.command_center.places import UnknownPlace, coordinates
from offboard.operate.operations import Order

DRAWN = {
    "line": (Operation.NO_GO_LINE, "a line that the robot must not cross"),
    "area": (Operation.NO_GO_AREA, "an area that the robot must not enter"),
    "only": (Operation.ONLY_HERE, "an area that the robot must not leave; of several it may be in each"),
}
REMOVE, ALL = "remove", "all"
FORMS = "line X,Y X,Y ..., area X,Y X,Y X,Y ..., only X,Y X,Y X,Y ..., or remove NUMBER"


def zone_order(words: Sequence[str]) -> Order:
    """Raises UnknownPlace with one sentence."""
    what, rest = (words[0].lower(), words[1:]) if words else ("", ())
    if what == REMOVE and len(rest) == 1:
        return Order(Operation.REMOVE_ZONE, zone=_number(rest[0].strip()))
    if what not in DRAWN:
        raise UnknownPlace(f"Write {FORMS}.")
    operation, _ = DRAWN[what]
    corners = tuple(_corner(text) for text in rest)
    problem = problem_with(KIND_OF[operation], corners)
    if problem:
        raise UnknownPlace(problem)
    return Order(operation, corners_m=corners)


def _corner(text: str) -> tuple[float, float]:
    corner = coordinates(text)
    if corner is None:
        raise UnknownPlace(f"A corner is written X,Y in metres, for example 3.5,-1; not {text.strip()}.")
    return corner


def _number(text: str) -> int:
    """0 for all of them."""
    if text.lower() == ALL:
        return 0
    if not (text.isascii() and text.isdigit() and 0 < int(text) < 2**53):
        raise UnknownPlace(f"A line or area is removed by its number, or by {ALL}; not {text}.")
    return int(text)
