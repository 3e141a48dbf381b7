"""Pictures of walls as one stands square before them: doors of hard looks and what stands on walls beside them.

A door here shows what real ones show where their colour shows nothing: the shadow and the light along its frame, the
gap around its leaf, a handle. Everything follows from a seed and the number of the wall.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from random import Random

import cv2
import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]
Picture = npt.NDArray[np.float32]  # (rows, columns, 3), blue green red, 0 to 255
Colour = npt.NDArray[np.float32]  # (3,)
Span = tuple[float, float]  # from, to, in metres to the right along the wall

LENGTH_M = 7.0
LOW_M, HIGH_M = 0.4, 2.6  # heights that a picture reaches
PX_PER_M = 500.0
PLAIN_END_M = 0.9  # at both ends of a wall nothing hangs
WIDEST_M = 1.4  # of what is beside doors, roughly


class Look(Enum):
    """Why a door is hard to see."""

    WHITE = "white on white"
    GREY = "grey on grey"
    GLASS = "glass"
    OPEN = "open"
    WOOD = "wood"  # it is not: for comparison


@dataclass(frozen=True, slots=True)
class ShownDoor:
    """A door on a wall: the middle of its leaf, and the leaf's width."""

    centre_m: float
    width_m: float


@dataclass(frozen=True, slots=True)
class Wall:
    """`front` is the wall's plane, `behind` what is seen through it, `open_share` (rows, columns) how much, of 255.

    `gaps`: where there is no wall for a sonar either. `others`: what else is on the wall.
    """

    look: Look
    front: Image
    behind: Image
    open_share: Image
    doors: tuple[ShownDoor, ...]
    gaps: tuple[Span, ...]
    others: tuple[str, ...]


@dataclass(slots=True)
class _Drawing:
    """A wall that is being drawn."""

    look: Look
    front: Picture
    open_share: npt.NDArray[np.float32]
    doors: list[ShownDoor] = field(default_factory=list)
    gaps: list[Span] = field(default_factory=list)
    others: list[str] = field(default_factory=list)

    def part(self, x: Span, z: Span) -> tuple[slice, slice]:
        """Rows and columns of a rectangle."""
        left, right = (round(PX_PER_M * v) for v in x)
        top, bottom = round(PX_PER_M * (HIGH_M - z[1])), round(PX_PER_M * (HIGH_M - z[0]))
        return slice(max(top, 0), max(bottom, 0)), slice(max(left, 0), max(right, left + 1))

    def fill(self, x: Span, z: Span, colour: Colour) -> None:
        self.front[self.part(x, z)] = colour

    def shade(self, x: Span, z: Span, factor: float) -> None:
        """Light or shadow on a rectangle."""
        self.front[self.part(x, z)] *= np.float32(factor)

    def relief(self, x: Span, z: Span, strength: float) -> None:
        """What stands out of a wall throws a shadow to one side and above it is dark; the other side is lit."""
        for at, factor in ((x[0], 1.0 - strength), (x[1], 1.0 + 0.4 * strength)):
            self.shade((at - 0.004, at + 0.004), z, factor)
        self.shade(x, (z[1] - 0.004, z[1] + 0.004), 1.0 - strength)


_Thing = Callable[[_Drawing, float, Colour, Random], float]  # draws itself from there on; how wide it is


def wall(look: Look, index: int, seed: int = 1) -> Wall:
    """Draws one wall with one to three doors of a look, and other things beside them."""
    rng = Random(f"{seed} {look.value} {index}")
    noise = np.random.default_rng(rng.getrandbits(32))
    rows, columns = round(PX_PER_M * (HIGH_M - LOW_M)), round(PX_PER_M * LENGTH_M)
    colour = _wall_colour(look, rng)
    front = np.broadcast_to(colour, (rows, columns, 3)).copy()
    drawn = _Drawing(look, front, np.zeros((rows, columns), np.float32))
    things: list[_Thing] = [rng.choice(_OTHERS), _door]
    rng.shuffle(things)
    things += [rng.choice((_door, *_OTHERS)) for _ in range(4)]
    x_m = PLAIN_END_M + rng.uniform(0.0, 0.4)
    for thing in things:
        if x_m < LENGTH_M - PLAIN_END_M - WIDEST_M:
            x_m += thing(drawn, x_m, colour, rng) + rng.uniform(0.35, 1.1)
    drawn.front *= _light(rows, columns, rng)[..., None]
    grain = cv2.resize(noise.normal(0, 1, (rows // 2, columns // 2)).astype(np.float32), (columns, rows))
    drawn.front += rng.uniform(0.5, 3.0) * grain[..., None]
    return Wall(
        look,
        _whole(drawn.front),
        _whole(_room(rows, columns, rng, noise)),
        _whole(255.0 * drawn.open_share),
        tuple(drawn.doors),
        tuple(drawn.gaps),
        tuple(drawn.others),
    )


def _whole(picture: npt.NDArray[np.float32]) -> Image:
    return np.asarray(np.clip(picture, 0, 255), np.uint8)


def _wall_colour(look: Look, rng: Random) -> Colour:
    level = rng.uniform(105, 175) if look is Look.GREY else rng.uniform(195, 240)
    return level * (1.0 + _tint(rng, 0.03))


def _tint(rng: Random, most: float) -> Colour:
    return np.array([rng.uniform(-most, most) for _ in range(3)], np.float32)


def _room(rows: int, columns: int, rng: Random, noise: np.random.Generator) -> Picture:
    """What is seen through a door: a room with furniture."""
    room = np.full((rows, columns, 3), rng.uniform(40, 190), np.float32) * (1.0 + _tint(rng, 0.1))
    for _ in range(40):
        left, top = rng.randrange(columns), rng.randrange(rows // 3, rows)
        wide, high = rng.randrange(60, 500), rng.randrange(60, 700)
        room[top : top + high, left : left + wide] = rng.uniform(20, 230) * (1.0 + _tint(rng, 0.15))
    room += np.asarray(noise.normal(0, 3, room.shape), np.float32)
    return np.asarray(cv2.GaussianBlur(room, (0, 0), 2.0), np.float32)


def _light(rows: int, columns: int, rng: Random) -> npt.NDArray[np.float32]:
    """Lamps along the hall."""
    x = np.linspace(0, LENGTH_M, columns, dtype=np.float32)[None, :]
    z = np.linspace(HIGH_M, LOW_M, rows, dtype=np.float32)[:, None]
    pitch_m, phase = rng.uniform(1.8, 3.5), rng.uniform(0, 6.3)
    waves = 1.0 + rng.uniform(0.0, 0.15) * np.cos(2 * np.pi * x / pitch_m + phase)
    return np.asarray(waves * (1.0 + rng.uniform(0.0, 0.12) * (z - 1.5)), np.float32)


def _door(wall: _Drawing, x_m: float, colour: Colour, rng: Random) -> float:
    """A frame, a leaf with the gap around it, a handle; returns how wide it is."""
    frame_m = rng.uniform(0.04, 0.10)
    leaf_m, high_m = rng.choice((0.80, 0.85, 0.9, 0.95, 1.0)), rng.uniform(1.98, 2.15)
    whole, leaf = (x_m, x_m + leaf_m + 2 * frame_m), (x_m + frame_m, x_m + frame_m + leaf_m)
    up, frame_up = (LOW_M, high_m), (LOW_M, high_m + frame_m)
    look = wall.look
    if look is Look.WOOD:
        leaf_colour = np.array([rng.uniform(40, 90), rng.uniform(80, 130), rng.uniform(120, 180)], np.float32)
        frame_colour = leaf_colour * np.float32(rng.uniform(0.6, 0.9))
    else:
        leaf_colour = colour * np.float32(rng.uniform(0.95, 1.04)) * (1.0 + _tint(rng, 0.008))
        frame_colour = colour * np.float32(rng.uniform(0.93, 1.03))
    if look is Look.GLASS:
        frame_colour = rng.uniform(60, 190) * (1.0 + _tint(rng, 0.02))
    wall.fill(whole, frame_up, frame_colour)
    wall.relief(whole, frame_up, rng.uniform(0.06, 0.25))
    if look is Look.OPEN:
        wall.open_share[wall.part(leaf, up)] = 1.0
        wall.gaps.append(leaf)
    else:
        wall.fill(leaf, up, leaf_colour)
        gap = rng.uniform(0.35, 0.8)
        for at in leaf:
            wall.shade((at - 0.002, at + 0.002), up, gap)
        wall.shade(leaf, (high_m - 0.002, high_m + 0.002), gap)
        if look is Look.GLASS:
            stile_m = rng.uniform(0.05, 0.12)
            wall.fill(leaf, up, frame_colour * np.float32(rng.uniform(0.9, 1.05)))
            pane = (leaf[0] + stile_m, leaf[1] - stile_m)
            share = rng.uniform(0.5, 0.9)
            wall.front[wall.part(pane, (LOW_M, high_m - stile_m))] = colour * np.float32(rng.uniform(0.5, 1.0))
            wall.open_share[wall.part(pane, (LOW_M, high_m - stile_m))] = share
        elif rng.random() < 0.3:  # mouldings
            for low, high in ((0.3, 0.9), (1.05, 1.85)):
                wall.relief((leaf[0] + 0.13, leaf[1] - 0.13), (low, high), rng.uniform(0.05, 0.2))
        if rng.random() < 0.9:
            _handle(wall, leaf, rng)
    wall.doors.append(ShownDoor((leaf[0] + leaf[1]) / 2, leaf_m))
    return whole[1] - whole[0]


def _handle(wall: _Drawing, leaf: Span, rng: Random) -> None:
    metal, z_m, inset_m = (
        rng.uniform(30, 170) * np.ones(3, np.float32),
        rng.uniform(0.99, 1.10),
        rng.uniform(0.04, 0.07),
    )
    right = rng.random() < 0.5
    at = leaf[1] - inset_m if right else leaf[0] + inset_m
    inwards = -1.0 if right else 1.0
    if wall.look is Look.GLASS and rng.random() < 0.5:
        wall.fill((at - 0.015, at + 0.015), (0.85, rng.uniform(1.2, 1.5)), metal)
        return
    ends = sorted((at - 0.01 * inwards, at + rng.uniform(0.10, 0.14) * inwards))
    wall.fill((ends[0], ends[1]), (z_m - 0.011, z_m + 0.011), metal)
    wall.fill((at - 0.025, at + 0.025), (z_m - 0.03, z_m + 0.03), metal * np.float32(1.1))


def _board(wall: _Drawing, x_m: float, colour: Colour, rng: Random) -> float:
    """A notice board or a whiteboard with a frame."""
    wide_m, low_m, high_m = rng.uniform(0.6, 1.4), rng.uniform(0.8, 1.0), rng.uniform(1.6, 1.84)
    wall.fill((x_m, x_m + wide_m), (low_m, high_m), rng.uniform(80, 235) * (1.0 + _tint(rng, 0.1)))
    wall.relief((x_m, x_m + wide_m), (low_m, high_m), 0.3)
    wall.others.append("board")
    return wide_m


def _poster(wall: _Drawing, x_m: float, colour: Colour, rng: Random) -> float:
    wide_m = rng.uniform(0.3, 0.85)
    high_m = 1.5 + 0.7 * wide_m / 2
    wall.fill((x_m, x_m + wide_m), (1.5 - 0.7 * wide_m / 2, high_m), rng.uniform(60, 240) * (1.0 + _tint(rng, 0.3)))
    for _ in range(6):
        z_m = rng.uniform(1.5 - 0.3 * wide_m, 1.5 + 0.3 * wide_m)
        wall.fill((x_m + 0.05, x_m + rng.uniform(0.4, 0.9) * wide_m), (z_m, z_m + 0.02), np.full(3, 40, np.float32))
    wall.others.append("poster")
    return wide_m


def _window(wall: _Drawing, x_m: float, colour: Colour, rng: Random) -> float:
    """Through it one sees a room or the sky; a sill below it."""
    wide_m, low_m, high_m = rng.uniform(0.7, 1.4), rng.uniform(0.85, 1.1), rng.uniform(1.95, 2.3)
    wall.fill((x_m, x_m + wide_m), (low_m, high_m), colour * np.float32(rng.uniform(0.6, 1.0)))
    wall.relief((x_m, x_m + wide_m), (low_m, high_m), 0.2)
    pane = wall.part((x_m + 0.06, x_m + wide_m - 0.06), (low_m + 0.06, high_m - 0.06))
    wall.open_share[pane] = rng.uniform(0.6, 1.0)
    wall.others.append("window")
    return wide_m


def _from_floor_up(name: str, wide_m: Span, shade: Span, relief: Span) -> _Thing:
    """Something that stands before the wall from floor to ceiling; its ranges are drawn from."""

    def draw(wall: _Drawing, x_m: float, colour: Colour, rng: Random) -> float:
        width_m = rng.uniform(*wide_m)
        wall.fill((x_m, x_m + width_m), (LOW_M, HIGH_M), colour * np.float32(rng.uniform(*shade)))
        wall.relief((x_m, x_m + width_m), (LOW_M, HIGH_M), rng.uniform(*relief))
        wall.others.append(name)
        return width_m

    return draw


def _panels(wall: _Drawing, x_m: float, colour: Colour, rng: Random) -> float:
    """Joints between boards of a light wall, all the way up."""
    pitch_m, count = rng.choice((0.9, 1.0, 1.2, 1.25)), rng.randrange(1, 3)
    for i in range(count + 1):
        at = x_m + i * pitch_m
        wall.shade((at - 0.002, at + 0.002), (LOW_M, HIGH_M), rng.uniform(0.6, 0.9))
    wall.others.append("panels")
    return count * pitch_m


def _cabinet(wall: _Drawing, x_m: float, colour: Colour, rng: Random) -> float:
    """A fire hose behind a small door with a knob."""
    wide_m, low_m, high_m = rng.uniform(0.55, 0.8), rng.uniform(0.6, 0.9), rng.uniform(1.4, 1.7)
    shade = np.array([40, 40, 190], np.float32) if rng.random() < 0.4 else colour * np.float32(rng.uniform(0.9, 1.05))
    wall.fill((x_m, x_m + wide_m), (low_m, high_m), shade)
    wall.relief((x_m, x_m + wide_m), (low_m, high_m), 0.3)
    knob_m = x_m + wide_m - 0.06
    wall.fill((knob_m - 0.02, knob_m + 0.02), (1.05, 1.09), np.full(3, 90, np.float32))
    wall.others.append("cabinet")
    return wide_m


def _switch(wall: _Drawing, x_m: float, colour: Colour, rng: Random) -> float:
    z_m = rng.uniform(1.02, 1.12)
    wall.fill((x_m, x_m + 0.08), (z_m - 0.04, z_m + 0.04), colour * np.float32(rng.uniform(0.8, 1.1)))
    wall.relief((x_m, x_m + 0.08), (z_m - 0.04, z_m + 0.04), 0.2)
    wall.others.append("switch")
    return 0.08


def _mouth(wall: _Drawing, x_m: float, colour: Colour, rng: Random) -> float:
    """A side hall goes off: no frame, no lintel."""
    wide_m = rng.uniform(1.3, 1.8)
    wall.open_share[wall.part((x_m, x_m + wide_m), (LOW_M, HIGH_M))] = 1.0
    wall.gaps.append((x_m, x_m + wide_m))
    wall.others.append("mouth")
    return wide_m


_PILLAR = _from_floor_up("pillar", (0.25, 0.6), (0.85, 1.1), (0.1, 0.3))
_PIPE = _from_floor_up("pipe", (0.03, 0.12), (0.7, 1.05), (0.1, 0.4))
_OTHERS = (_board, _poster, _window, _PILLAR, _PIPE, _panels, _cabinet, _switch, _mouth)
