"""Whether an edge runs along an end of a line and on above and below it: the border of what hides the rest of it.

What covers a plate may be nearly of its colour, and half a letter looks like another one. But its border runs straight
on where no letters are, and there even a faint step stands out from the even ground of a plate. Lengths are shares of
the height of a capital.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from onboard.poi.signs.letters import Strokes

BAND = (0.12, 0.4)  # off the letters: the ground on which an edge is looked for
AROUND = 0.15  # the end of the letters: as far as an edge that runs askew comes away from it
TALL = 0.6  # lower letters do not show where a line ends above
REACH = 0.15  # over which it may be blurred
BESIDE = 0.5  # of an edge, where the ground changes as little as elsewhere
FAINT = 0.03  # smallest step of the ground, share of the letters' contrast
STANDS_OUT = 4.0  # times the usual change of the ground
Profile = npt.NDArray[np.float64]  # (N,), grey


def edges_along(line: Strokes, capital: float) -> list[str]:
    """The sides at which an edge runs along the letters."""
    x0, x1 = line.letters[0].x, line.letters[-1].right
    # Of most letters: a bar reaches further
    tall = [letter for letter in line.letters if letter.height >= TALL * capital] or list(line.letters)
    top = float(np.median([letter.y for letter in tall]))
    bottom = float(np.median([letter.bottom for letter in tall]))
    near, far = BAND[0] * capital, BAND[1] * capital
    above, below = _ground(line, (top - far, top - near), 0), _ground(line, (bottom + near, bottom + far), 0)
    left, right = _ground(line, (x0 - far, x0 - near), 1), _ground(line, (x1 + near, x1 + far), 1)
    sides = []
    for side, at, bands in (
        ("left", x0, (above, below)),
        ("right", x1, (above, below)),
        ("above", top, (left, right)),
        ("below", bottom, (left, right)),
    ):
        ends = (x0, x1) if bands[0] is above else (top, bottom)
        steps = [_step(band, at, ends, line.contrast, capital) for band in bands]
        if all(steps) and steps[0] * steps[1] > 0.0:
            sides.append(side)
    return sides


def _ground(line: Strokes, span: tuple[float, float], axis: int) -> Profile:
    """The mean over the rows (axis 0) or columns (axis 1) of a span."""
    size = line.gray.shape[axis]
    a, b = max(round(span[0]), 0), min(max(round(span[1]), round(span[0]) + 1), size)
    part = line.gray[a:b] if axis == 0 else line.gray[:, a:b]
    return part.mean(axis=axis, dtype=np.float64) if part.size else np.zeros(line.gray.shape[1 - axis])


def _step(ground: Profile, at: float, ends: tuple[float, float], contrast: float, capital: float) -> float:
    """The step of the ground near a place, 0 where it is none or does not stand out."""
    reach = max(round(REACH * capital), 1)
    changes = ground[reach:] - ground[:-reach]
    middle = at - reach / 2
    a, b = (max(round(middle + way * AROUND * capital), 0) for way in (-1, 1))
    close = changes[a : b + 1]
    if not close.size:
        return 0.0
    at_step = a + int(np.abs(close).argmax())
    step = float(changes[at_step])
    # Light that falls on a plate changes the ground beside its strongest change, too
    near, far = reach + 1, reach + round(BESIDE * capital)
    usual = max(
        _median(changes[max(round(ends[0] - capital), 0) : max(round(ends[1] + capital), 0)]),
        _median(changes[max(at_step - far, 0) : max(at_step - near, 0)]),
        _median(changes[at_step + near : at_step + far]),
    )
    return step if abs(step) > max(FAINT * contrast, STANDS_OUT * usual) else 0.0


def _median(changes: Profile) -> float:
    return float(np.median(np.abs(changes))) if changes.size else 0.0
