"""Whether an edge runs along an end of a line and on above and below it: the border of what hides the rest of it.

What covers a plate may be nearly of its colour, and half a letter looks like another one. But its border runs straight
on where no letters are, and there even a faint step stands out from the even ground of a plate. The plate's own border
leaves the letters some room above and below, and the same room on both sides. Lengths are shares of a capital's height.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from onboard.poi.signs.letters import Strokes

BAND = (0.12, 0.4)  # off the letters: the ground on which an edge is looked for
ASKEW = 0.15  # as far from the letters' end an edge that runs askew may be seen, and another letter be hidden
TOUCHING = 0.045  # above and below an edge that hides something touches the letters
BORDER = 0.5  # as far beyond both ends a plate's border is looked for
ALIKE, SAME_STEP = 0.2, 0.35  # difference of the room on both sides (before a 1 it is wider), and of the two steps
TALL = 0.6  # lower letters do not show where a line ends above
REACH = 0.15  # over which an edge may be blurred
EVEN = 0.5  # beside an edge, where the ground changes as little as elsewhere
FAINT = 0.03  # smallest step of the ground, share of the letters' contrast
PEAK = 2  # rows or columns around the largest change
STANDS_OUT = 4.0  # times the usual change of the ground
Profile = npt.NDArray[np.float64]  # (N,), grey


@dataclass(frozen=True, slots=True)
class Side:
    """One end of a line: where the letters beside each of both `grounds` end along it; which way is out of them."""

    name: str
    grounds: tuple[Profile, Profile]
    at: tuple[float, float]
    ends: tuple[float, float]  # of the letters, in the same direction
    outwards: int


def edges_along(line: Strokes, capital: float) -> list[str]:
    """The sides at which an edge runs along the letters."""
    sides = {side.name: side for side in _sides(line, capital)}
    found = [
        name
        for name, side in sides.items()
        if (edge := _edge(side, line.contrast, capital, ASKEW)) is not None
        and (name in ("left", "right") or edge[0] < TOUCHING * capital)
    ]
    if ("left" in found or "right" in found) and _of_plate(sides["left"], sides["right"], line.contrast, capital):
        found = [name for name in found if name not in ("left", "right")]
    return found


def _of_plate(left: Side, right: Side, contrast: float, capital: float) -> bool:
    """Whether both sides have like edges that leave the letters like room, as a number that fills a narrow plate."""
    one, other = (_edge(side, contrast, capital, BORDER) for side in (left, right))
    if one is None or other is None:
        return False
    alike = abs(one[0] - other[0]) < ALIKE * capital and abs(one[1] - other[1]) < SAME_STEP * abs(one[1])
    return alike and min(one[0], other[0]) > TOUCHING * capital


def _sides(line: Strokes, capital: float) -> Iterator[Side]:
    x0, x1 = line.letters[0].x, line.letters[-1].right
    # Of most letters: a bar reaches further
    tall = [letter for letter in line.letters if letter.height >= TALL * capital] or list(line.letters)
    first, last = tall[0], tall[-1]
    top = float(np.median([letter.y for letter in tall]))
    bottom = float(np.median([letter.bottom for letter in tall]))
    near, far = BAND[0] * capital, BAND[1] * capital
    rows = _ground(line, (top - far, top - near), 0), _ground(line, (bottom + near, bottom + far), 0)
    columns = _ground(line, (x0 - far, x0 - near), 1), _ground(line, (x1 + near, x1 + far), 1)
    yield Side("left", rows, (x0, x0), (x0, x1), -1)
    yield Side("right", rows, (x1, x1), (x0, x1), 1)
    # What lies askew hides more of the first letter than of the last, or less
    yield Side("above", columns, (first.y, last.y), (top, bottom), -1)
    yield Side("below", columns, (first.bottom, last.bottom), (top, bottom), 1)


def _ground(line: Strokes, span: tuple[float, float], axis: int) -> Profile:
    """The mean over the rows (axis 0) or columns (axis 1) of a span."""
    size = line.gray.shape[axis]
    a, b = max(round(span[0]), 0), min(max(round(span[1]), round(span[0]) + 1), size)
    part = line.gray[a:b] if axis == 0 else line.gray[:, a:b]
    return part.mean(axis=axis, dtype=np.float64) if part.size else np.zeros(line.gray.shape[1 - axis])


def _edge(side: Side, contrast: float, capital: float, out: float) -> tuple[float, float] | None:
    """How far beyond the letters' end both grounds show an edge, at most `out`, and its step outwards; None without."""
    one, other = (
        _step(ground, at, side, contrast, capital, out) for ground, at in zip(side.grounds, side.at, strict=True)
    )
    if one is None or other is None or one[1] * other[1] < 0.0:
        return None
    return side.outwards * (one[0] + other[0]) / 2, side.outwards * (one[1] + other[1]) / 2


def _step(
    ground: Profile, end: float, side: Side, contrast: float, capital: float, out: float
) -> tuple[float, float] | None:
    """Where a ground has its largest step, from an end of the letters; and that step. None where none stands out."""
    reach = max(round(REACH * capital), 1)
    changes = ground[reach:] - ground[:-reach]
    window = (end - side.outwards * ASKEW * capital, end + side.outwards * out * capital)
    a, b = (max(round(limit - reach / 2), 0) for limit in sorted(window))
    close = changes[a : b + 1]
    if not close.size:
        return None
    at = a + int(np.abs(close).argmax())
    step = float(changes[at])
    if np.abs(changes[max(at - PEAK, 0) : at + PEAK + 1]).max() > abs(step):  # of an edge further away
        return None
    # Light that falls on a plate changes the ground beside its strongest change, too
    near, far = reach + 1, reach + round(EVEN * capital)
    usual = max(
        _median(changes[max(round(side.ends[0] - capital), 0) : max(round(side.ends[1] + capital), 0)]),
        _median(changes[max(at - far, 0) : max(at - near, 0)]),
        _median(changes[at + near : at + far]),
    )
    return (at + reach / 2 - end, step) if abs(step) > max(FAINT * contrast, STANDS_OUT * usual) else None


def _median(changes: Profile) -> float:
    return float(np.median(np.abs(changes))) if changes.size else 0.0
