"""Jambs in a preview: upright lines that run through all of it, alone or in pairs, whatever colours they part.

A door of its wall's colour shows the shadow along its frame and the gap around its leaf: lines that run from below
every sign to above what hangs on walls. The picture is averaged piece by piece over its height, which leaves little
noise and nothing that is not upright; a line has one sign of step in nearly all pieces. What is beside it tells a jamb
from the side of a board or window: no line leads away from it at the height of those.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from onboard.poi.camera.camera_model import CameraModel
from onboard.poi.camera.frame import Gray

LOW_M, HIGH_M = 0.90, 1.95  # above the floor: where lines are looked for, below the lintel
RISEN_M = 1.88  # a line that is seen up to here is higher than what hangs on walls
PIECE_M = 0.10  # of height, averaged
THROUGH = 0.85  # share of the pieces in which a line shows
NOISES, STEP_MIN = 4.5, 1.6  # of a step: in the noise of all columns, and in grey values
TILT_MAX_PX = 10  # of a line from its foot to its head: the mast is not quite upright
LINE_M = 0.012  # lines nearer to each other are one
FRAME_M, JAMB_M = 0.11, 0.25  # between lines of one jamb: neighbours, and in all
DOUBLE_M = 0.02  # between the outermost lines of a jamb with frame and gap
BORDER_M = 0.05  # a jamb nearer to the picture's border may be cut
BESIDE_M = (0.02, 0.30)  # from a jamb: where lines that lead away from it are looked for
BESIDE_MIN_M = 0.2  # of which so much must be in the picture
PARTS = 4  # of that, in all of which such a line shows
CROSSED_M = (0.82, 1.86)  # heights of sills, and of the rims of boards
LINTEL_M = (1.93, 2.3)  # of a door
LINTEL_SEEN_M = 2.1  # a picture that reaches no higher shows none

SD_OF_MEDIAN = 1.4826  # standard deviation over median of what is normal, unsigned

Grey = npt.NDArray[np.float32]


class Beside(NamedTuple):
    """What leads away from a jamb, to its left and right; None where too little of that side is in the picture."""

    left: bool | None
    right: bool | None


@dataclass(frozen=True, slots=True)
class JambView:
    """A jamb in a column of the preview, the middle between its outermost lines, which are `width_m` apart.

    `doubled`: it has a line on both sides of its frame. `risen`: it is higher than what hangs on walls, as far as the
    picture shows. `crossed`: a line leads away from it lower than a lintel; `capped`: at the height of one.
    """

    u_px: float
    width_m: float
    doubled: bool
    risen: bool
    crossed: Beside
    capped: Beside


def jamb_views(gray: Gray, camera: CameraModel, depth_m: float) -> list[JambView]:
    """All jambs of a preview, from left to right; `depth_m` to the wall."""
    top_m, bottom_m = min(camera.height_m(0, depth_m), HIGH_M), max(camera.height_m(camera.height_px, depth_m), LOW_M)
    rows = [int(np.clip(camera.row_px(z, depth_m), 0, camera.height_px)) for z in (top_m, bottom_m)]
    pieces = int((top_m - bottom_m) / PIECE_M)
    if pieces < 4:
        return []
    m_per_px = camera.metres_per_px(depth_m)
    lines = _through(_vertical_steps(gray[rows[0] : rows[1]], pieces), max(LINE_M / m_per_px, 2.0))
    border_px = BORDER_M / m_per_px
    jambs = []
    for group in _grouped(lines, m_per_px):
        left, right = group[0], group[-1]
        if left < border_px or right > camera.width_px - border_px:
            continue
        sides = [_beside(gray, camera, depth_m, at, way) for at, way in ((left, -1), (right, 1))]
        crossed, capped = zip(*sides, strict=True)
        width_m = (right - left) * m_per_px
        middle_px, risen = (left + right) / 2, top_m > RISEN_M
        jambs.append(JambView(middle_px, width_m, width_m > DOUBLE_M, risen, Beside(*crossed), Beside(*capped)))
    return jambs


def _vertical_steps(strip: Gray, pieces: int) -> Grey:
    """Steps (pieces, columns) between the columns beside each, piece by piece, of a strip that stands upright."""
    steps = _steps(_means(strip, pieces))

    def leaning(tilt_px: float) -> Grey:
        shifts = np.round(np.linspace(-tilt_px / 2, tilt_px / 2, pieces)).astype(int)
        return np.stack([np.roll(row, shift) for row, shift in zip(steps, shifts, strict=True)])

    tilts = range(-TILT_MAX_PX, TILT_MAX_PX + 1, 2)
    return max(map(leaning, tilts), key=lambda one: float((one.sum(axis=0) ** 2).sum()))


def _means(strip: Gray, pieces: int) -> Grey:
    """Mean (pieces, columns) of each piece of the strip's height."""
    whole = strip[: strip.shape[0] // pieces * pieces].astype(np.float32)
    return np.asarray(whole.reshape(pieces, -1, strip.shape[1]).mean(axis=1))


def _steps(means: Grey) -> Grey:
    """Between the neighbours of each column of (pieces, columns)."""
    steps = np.zeros_like(means)
    steps[:, 2:-2] = means[:, 3:-1] - means[:, 1:-3]
    return steps


def _shows(steps: Grey) -> npt.NDArray[np.bool_]:
    """Where a piece has a step of its column's sign that stands out of the noise: most columns show nothing."""
    least = max(NOISES * SD_OF_MEDIAN * float(np.median(np.abs(steps))), STEP_MIN)
    signed = steps * np.sign(steps.sum(axis=0))
    near = np.maximum(signed, np.maximum(np.roll(signed, 1, axis=1), np.roll(signed, -1, axis=1)))
    return np.asarray(near > least)


def _through(steps: Grey, apart_px: float) -> list[int]:
    """Columns of lines that show at both ends and in THROUGH of the pieces, the clearest first taken."""
    shows = _shows(steps)
    whole = (shows.mean(axis=0) >= THROUGH) & shows[0] & shows[-1]
    strength = np.where(whole, np.abs(steps.sum(axis=0)), 0.0)
    found: list[int] = []
    for column in np.argsort(-strength, kind="stable"):
        if strength[column] <= 0.0:
            break
        if all(abs(int(column) - other) >= apart_px for other in found):
            found.append(int(column))
    return sorted(found)


def _grouped(lines: list[int], m_per_px: float) -> list[list[int]]:
    """Lines of one jamb."""
    groups: list[list[int]] = []
    for line in lines:
        near = groups and (line - groups[-1][-1]) * m_per_px < FRAME_M and (line - groups[-1][0]) * m_per_px < JAMB_M
        if near:
            groups[-1].append(line)
        else:
            groups.append([line])
    return groups


def _beside(gray: Gray, camera: CameraModel, depth_m: float, at_px: int, way: int) -> tuple[bool | None, bool | None]:
    """Whether a level line leads away from a column to the left (-1) or right (1): lower than a lintel, and as one."""
    m_per_px = camera.metres_per_px(depth_m)
    ends = sorted(int(np.clip(at_px + way * d / m_per_px, 0, camera.width_px)) for d in BESIDE_M)
    if (ends[1] - ends[0]) * m_per_px < BESIDE_MIN_M:
        return None, None
    means = _means(np.ascontiguousarray(gray[:, ends[0] : ends[1]].T), PARTS)
    level = np.logical_and.reduce(_shows(_steps(means)), axis=0)

    def within(low_m: float, high_m: float) -> bool:
        top, bottom = (int(np.clip(camera.row_px(z, depth_m), 2, camera.height_px - 2)) for z in (high_m, low_m))
        return bool(level[top:bottom].any())

    capped = within(*LINTEL_M) if camera.height_m(0, depth_m) > LINTEL_SEEN_M else None
    return within(*CROSSED_M), capped
