"""Signs in pictures of a camera: tilted onto walls and photographs, covered, lit, blurred, noisy, and compressed.

Everything follows from a seed and the number of the case, so that a case can be drawn again by itself. Half of the
signs hang on photographs where their packages are installed; without those, on walls only, and the cases are others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from math import cos, pi, radians, sin, tan
from pathlib import Path
from random import Random

import cv2
import numpy as np
import numpy.typing as npt

from offboard.evaluate.signs.layouts import DRAWN_CAPITALS_PX, Drawn, Layout, draw_notice, draw_plate, halves
from offboard.evaluate.signs.photographs import Image, backdrop, photographs, view
from offboard.evaluate.signs.texts import FORMS, NumberForm, distractor

SIZE_PX = (1280, 960)
CAPITALS_PX = (22.0, 60.0)
FOCAL_PX = 1061.0  # of the camera at that size, for the perspective of a tilted sign


class Kind(Enum):
    """What a case asks of the reader."""

    PLATE = "plate"  # its number
    COVERED = "covered"  # its number or none: something hides a part of a letter
    DISTRACTOR = "distractor"  # nothing
    COMPOSITE = "on a photograph"  # its number: a plate on a part of any photograph
    PHOTOGRAPH = "no sign"  # nothing: a part of any photograph


@dataclass(frozen=True, slots=True)
class Case:
    """One picture and what is in it; `number` as the plate shows it, empty where there is none."""

    kind: Kind
    index: int
    form: NumberForm
    layout: Layout | None
    number: str
    font: str
    capitals_px: float
    tilt_deg: tuple[float, float, float]  # yaw, pitch, roll
    image: Image


def case(kind: Kind, index: int, fonts: Sequence[str], seed: int = 1) -> Case:
    """Draws one case. Every form comes with every font in turn; the rest is drawn from the seed.

    Kind.COMPOSITE and Kind.PHOTOGRAPH need photographs.
    """
    rng = Random(f"{seed} {kind.value} {index}")
    form, font = FORMS[index % len(FORMS)], fonts[(index // len(FORMS) + index) % len(fonts)]
    number, layout = "", None
    if kind is Kind.PHOTOGRAPH:
        picture = _photographed(view(rng, SIZE_PX), CAPITALS_PX[0], rng, np.random.default_rng(rng.getrandbits(32)))
        return Case(kind, index, form, None, "", "", CAPITALS_PX[0], (0.0, 0.0, 0.0), picture)
    if kind is Kind.DISTRACTOR:
        drawn = draw_notice(distractor(rng), font, rng)
    else:
        number = form.draw(rng)
        usual = [one for one in Layout if one is not Layout.TWO_LINES or halves(number) is not None]
        layout = Layout.NUMBER if kind is Kind.COVERED and rng.random() < 0.5 else rng.choice(usual)
        if kind is Kind.COVERED and layout is Layout.TWO_LINES:
            layout = Layout.NUMBER
        drawn = draw_plate(layout, form.before + number, font, rng)
    capitals_px = CAPITALS_PX[0] * (CAPITALS_PX[1] / CAPITALS_PX[0]) ** rng.random()
    tilt_deg = rng.uniform(-40, 40), rng.uniform(-10, 10), rng.gauss(0, 4)
    image = _scene(kind, drawn, capitals_px, tilt_deg, rng)
    return Case(kind, index, form, layout, number, font, capitals_px, tilt_deg, image)


def drawable() -> list[Kind]:
    """The kinds that can be drawn with what is installed."""
    return [kind for kind in Kind if photographs() or kind not in (Kind.COMPOSITE, Kind.PHOTOGRAPH)]


def store(image: Image, file: Path) -> None:
    """As a JPEG of good quality."""
    cv2.imwrite(str(file), image, [cv2.IMWRITE_JPEG_QUALITY, 95])


def _scene(kind: Kind, drawn: Drawn, capitals_px: float, tilt_deg: tuple[float, float, float], rng: Random) -> Image:
    noise = np.random.default_rng(rng.getrandbits(32))
    flat = np.asarray(drawn.picture)[..., ::-1].astype(np.float32)
    if kind is Kind.COMPOSITE:
        behind = view(rng, SIZE_PX, printed=False)
    else:
        behind = backdrop(rng, SIZE_PX) if photographs() and rng.random() < 0.5 else _wall(rng, noise)
    if kind is Kind.COVERED:
        _cover(flat, drawn, rng)
    if rng.random() < 0.3:
        _shine(flat, rng, 0.5)
    scale = capitals_px / DRAWN_CAPITALS_PX
    # As much of the sign as fits the picture, which a long notice may not
    scale = min(scale, 0.9 * SIZE_PX[0] / flat.shape[1], 0.9 * SIZE_PX[1] / flat.shape[0])
    picture = _tilted(flat, behind, scale, tilt_deg, rng)
    return _photographed(picture, capitals_px, rng, noise)


def _wall(rng: Random, noise: np.random.Generator) -> npt.NDArray[np.float32]:
    """Plain, with a gradient of light."""
    width, height = SIZE_PX
    colour = np.array([rng.uniform(90, 245) for _ in range(3)], np.float32)
    colour = 0.7 * colour.mean() + 0.3 * colour
    light = 1.0 + rng.uniform(-0.3, 0.3) * np.linspace(-0.5, 0.5, width, dtype=np.float32)[None, :, None]
    grain = cv2.resize(noise.normal(0, 4, (height // 4, width // 4)).astype(np.float32), SIZE_PX)[..., None]
    return np.asarray(colour * light + grain, np.float32)


def _cover(flat: npt.NDArray[np.float32], drawn: Drawn, rng: Random) -> None:
    """Something hides 0.3 to 0.8 of an outer letter, or of all of them from above or below, or light erases one."""
    letters = drawn.letters
    top, bottom = min(b[1] for b in letters), max(b[3] for b in letters)
    cap = bottom - top
    share = rng.uniform(0.3, 0.8)
    shade = np.array([rng.uniform(20, 235)] * 3, np.float32) + np.float32(rng.uniform(-15, 15))
    way = rng.choice(("left", "left", "right", "above", "below", "light"))
    if way == "light":
        x0, y0, x1, y1 = rng.choice(letters)
        _spot(flat, ((x0 + x1) / 2, (y0 + y1) / 2), 0.8 * cap, rng.uniform(0.85, 1.0))
    elif way in ("left", "right"):
        x0, _, x1, _ = letters[0 if way == "left" else -1]
        edge = round(x0 + share * (x1 - x0)) if way == "left" else round(x1 - share * (x1 - x0))
        reach = round(rng.uniform(0.7, 3.0) * cap)
        rows = slice(max(round(top - 0.8 * cap), 0), round(bottom + 0.8 * cap)) if rng.random() < 0.3 else slice(None)
        hidden = slice(max(edge - reach, 0), edge) if way == "left" else slice(edge, edge + reach)
        flat[rows, hidden] = shade
    elif way == "above":
        flat[: round(top + 0.6 * share * cap)] = shade
    else:
        flat[round(bottom - 0.6 * share * cap) :] = shade


def _spot(flat: npt.NDArray[np.float32], centre: tuple[float, float], radius: float, strength: float) -> None:
    y, x = np.mgrid[: flat.shape[0], : flat.shape[1]].astype(np.float32)
    away = np.hypot(x - centre[0], y - centre[1]) / radius
    share = np.float32(strength) * np.clip(1.6 - away, 0, 1)[..., None]
    flat += share * (np.float32(252) - flat)


def _shine(flat: npt.NDArray[np.float32], rng: Random, strength: float) -> None:
    """A lamp mirrored somewhere on the sign, through which letters stay legible."""
    centre = rng.uniform(0, flat.shape[1]), rng.uniform(0, flat.shape[0])
    _spot(flat, centre, rng.uniform(0.2, 0.6) * flat.shape[0], strength * rng.random())


def _tilted(
    flat: npt.NDArray[np.float32], backdrop: npt.NDArray[np.float32], scale: float,
    tilt_deg: tuple[float, float, float], rng: Random,
) -> npt.NDArray[np.float32]:  # fmt: skip
    """The sign on the backdrop, seen in perspective, `scale` at its middle."""
    height, width = flat.shape[:2]
    yaw, pitch, roll = (radians(angle) for angle in tilt_deg)
    corners = np.array([(0, 0), (width, 0), (width, height), (0, height)], np.float32)
    placed = []
    for u, v in (corners - (width / 2, height / 2)) * scale:
        u, v = u * cos(roll) - v * sin(roll), u * sin(roll) + v * cos(roll)
        depth = FOCAL_PX + u * sin(yaw) + v * sin(pitch)
        placed.append((u * cos(yaw) * FOCAL_PX / depth, v * cos(pitch) * FOCAL_PX / depth))
    reach_x, reach_y = (max(abs(p[i]) for p in placed) + 12 for i in (0, 1))
    middle = (
        rng.uniform(reach_x, max(SIZE_PX[0] - reach_x, reach_x + 1)),
        rng.uniform(reach_y, max(SIZE_PX[1] - reach_y, reach_y + 1)),
    )
    target = np.array([(middle[0] + x, middle[1] + y) for x, y in placed], np.float32)
    # Shrunk before it is warped: a warp alone skips pixels
    if scale < 1.0:
        flat = cv2.resize(flat, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        corners = corners * np.float32(scale)
    matrix = cv2.getPerspectiveTransform(corners, target)
    shown = cv2.warpPerspective(flat, matrix, SIZE_PX, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    mask = cv2.warpPerspective(np.ones(flat.shape[:2], np.float32), matrix, SIZE_PX)[..., None]
    return np.asarray(mask * shown + (1 - mask) * backdrop, np.float32)


def _photographed(
    picture: npt.NDArray[np.float32], capitals_px: float, rng: Random, noise: np.random.Generator
) -> Image:
    """Defocus, motion and a rolling shutter as letters of that height still bear; exposure, noise, JPEG."""
    picture = cv2.GaussianBlur(picture, (0, 0), max(rng.uniform(0.0, 0.05) * capitals_px, 0.3))
    length = round(rng.uniform(0.0, 0.12) * capitals_px)
    if length > 1:
        kernel = np.zeros((length, length), np.float32)
        turn = rng.uniform(0, pi)
        for t in np.linspace(-0.5, 0.5, 4 * length):
            x, y = (round((length - 1) * (0.5 + t * f(turn))) for f in (cos, sin))
            kernel[y, x] += 1
        picture = cv2.filter2D(picture, -1, kernel / kernel.sum())
    if rng.random() < 0.3:  # rows are read out one after the other while the robot drives
        shear = np.array([[1, tan(radians(rng.uniform(-2, 2))), 0], [0, 1, 0]], np.float32)
        picture = cv2.warpAffine(picture, shear, SIZE_PX, borderMode=cv2.BORDER_REPLICATE)
    picture = picture * rng.uniform(0.4, 1.05) + noise.normal(0, rng.uniform(1, 6), picture.shape).astype(np.float32)
    works, data = cv2.imencode(
        ".jpg", np.clip(picture, 0, 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, rng.randrange(50, 93)]
    )
    assert works
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)
