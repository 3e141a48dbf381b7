"""What the mapping unit sends of its map: grid a few rows at a time, wall points echoed and concluded."""

from __future__ import annotations

import subprocess
import sys
import zlib
from math import pi

import numpy as np
import pytest

from common.geometry import Points, Pose2
from onboard.mmu.back_end.map_builder import REDRAW_WAY_M, Rounds
from onboard.mmu.map import grid_encoder
from onboard.mmu.map.grid_encoder import GridPress
from onboard.mmu.map.keyframes import Increment, KeyFrame
from onboard.mmu.map.occupancy import OccupancyGrid
from onboard.mmu.map.wall_points import WallPoints, WallStore

NONE: Points = np.zeros((0, 2))


def grid() -> OccupancyGrid:
    made = OccupancyGrid()
    for x_m in np.arange(-5.0, 5.0, 0.1).tolist():
        made.add_walls(np.array([[x_m, 2.0]] * 2), np.array([pi / 2] * 2))
    made.add_rays(np.array([[0.0, 0.0]]), np.array([pi / 2]), np.array([2.0]))
    return made


@pytest.mark.parametrize("at_once", [100, 1000, 10_000_000])
def test_a_grid_pressed_in_parts_is_the_whole_grid(monkeypatch: pytest.MonkeyPatch, at_once: int) -> None:
    monkeypatch.setattr(grid_encoder, "CELLS_AT_ONCE", at_once)
    whole = grid()
    press = GridPress()
    assert press.advance(0.0) is None
    press.begin(whole)
    steps = 1
    while (update := press.advance(steps * 0.05)) is None:
        assert press.busy
        steps += 1
    assert not press.busy
    assert (update.rows, update.columns) == whole.shape
    assert zlib.decompress(update.cells_zlib) == whole.cells().tobytes()
    assert steps == max(1, -(-whole.shape[0] // max(at_once // whole.shape[1], 1)))


def test_a_grid_that_grows_while_it_is_pressed_goes_out_as_large_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grid_encoder, "CELLS_AT_ONCE", 1000)
    growing = grid()
    shape, origin_m = growing.shape, growing.origin_m
    press = GridPress()
    press.begin(growing)
    press.advance(0.0)
    growing.add_walls(np.array([[-30.0, 30.0]]), np.array([0.0]))
    assert growing.shape != shape
    while (update := press.advance(0.0)) is None:
        pass
    assert (update.rows, update.columns) == shape
    assert (update.origin_x_m, update.origin_y_m) == origin_m


def test_wall_points_are_kept_in_the_order_in_which_they_came() -> None:
    store = WallStore()
    store.append(WallPoints.of(np.array([[1.0, 2.0]]), NONE))
    store.append(WallPoints.of(np.array([[3.0, 4.0]]), np.array([[5.0, 6.0]])))
    assert len(store) == 3
    assert store.since(1).points_m.tolist() == [[3.0, 4.0], [5.0, 6.0]]
    assert store.since(0).inferred.tolist() == [0, 0, 1]
    store.begin_anew(WallPoints.of(np.array([[7.0, 8.0]] * 2), NONE))
    assert store.since(0).points_m.tolist() == [[7.0, 8.0]] * 2


def drive(start: int, count: int) -> Increment:
    frames = tuple(
        KeyFrame(2.0 * i, Pose2(0.4 * i, 0.0, 0.0), 0.4 * i, 0.4 * i, 0.0, 0.0) for i in range(start, start + count)
    )
    echoes = np.array([[i, 0.4 * i, 0.1 * k, 1.0, pi / 2, 1.0] for i in range(start, start + count) for k in range(4)])
    return Increment(frames, echoes, np.zeros((0, 6)))


def test_walls_are_drawn_anew_from_time_to_time_though_nothing_moved() -> None:
    rounds = Rounds()
    assert rounds.take(drive(0, 5)).walls is None
    frames = round(REDRAW_WAY_M / 0.4)
    correction = rounds.take(drive(5, frames))
    assert correction.walls is not None
    assert correction.grid is None
    echoed = correction.walls.points_m[correction.walls.inferred == 0]
    assert len(echoed) == 4 * (5 + frames)
    assert np.abs(echoed[:, 1] - 1.0).max() < 0.01


def test_the_front_end_loads_nothing_of_scipy_until_it_is_called() -> None:
    lines = (
        "import sys, onboard.mmu.mmu",
        "print(any(name.partition('.')[0] == 'scipy' for name in sys.modules))",
        "from filterpy.stats import logpdf",
        "print(round(logpdf(1.0, 0.0, 2.0), 4), 'scipy.stats' in sys.modules)",
    )
    told = subprocess.run([sys.executable, "-c", "\n".join(lines)], check=True, capture_output=True, text=True).stdout
    assert told.split() == ["False", "-1.5155", "True"]
