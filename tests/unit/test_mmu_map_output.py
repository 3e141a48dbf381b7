"""What the mapping unit publishes of its map: grid a few rows at a time, wall points echoed and inferred."""

from __future__ import annotations

import subprocess
import sys
import zlib
from math import pi

import numpy as np
import pytest

from common.geometry import Points, Pose2
from onboard.mmu.back_end.exchange import Increment
from onboard.mmu.back_end.map_builder import REDRAW_PATH_M, MapBuilder
from onboard.mmu.map import grid_encoder
from onboard.mmu.map.grid_encoder import GridEncoder
from onboard.mmu.map.keyframes import Keyframe
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
def test_a_grid_compressed_in_parts_is_the_whole_grid(monkeypatch: pytest.MonkeyPatch, at_once: int) -> None:
    monkeypatch.setattr(grid_encoder, "CELLS_AT_ONCE", at_once)
    whole = grid()
    encoder = GridEncoder()
    assert encoder.advance(0.0) is None
    encoder.begin(whole)
    steps = 1
    while (update := encoder.advance(steps * 0.05)) is None:
        assert encoder.busy
        steps += 1
    assert not encoder.busy
    assert (update.rows, update.columns) == whole.shape
    assert zlib.decompress(update.cells_zlib) == whole.cells().tobytes()
    assert steps == max(1, -(-whole.shape[0] // max(at_once // whole.shape[1], 1)))


def test_a_grid_that_grows_meanwhile_is_published_as_large_as_it_was(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(grid_encoder, "CELLS_AT_ONCE", 1000)
    growing = grid()
    shape, origin_m = growing.shape, growing.origin_m
    encoder = GridEncoder()
    encoder.begin(growing)
    encoder.advance(0.0)
    growing.add_walls(np.array([[-30.0, 30.0]]), np.array([0.0]))
    assert growing.shape != shape
    while (update := encoder.advance(0.0)) is None:
        pass
    assert (update.rows, update.columns) == shape
    assert (update.origin_x_m, update.origin_y_m) == origin_m


def test_a_grid_that_no_message_can_hold_is_left_out_and_said_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    whole = grid()
    encoder = GridEncoder()
    monkeypatch.setattr(grid_encoder, "GRID_CELLS_MAX", whole.shape[0] * whole.shape[1] - 1)
    for _ in range(2):
        encoder.begin(whole)
        assert not encoder.busy
        assert encoder.advance(0.0) is None
    assert caplog.text.count("too large for one map") == 1


def test_wall_points_are_kept_in_the_order_in_which_they_came() -> None:
    store = WallStore()
    store.append(WallPoints.of(np.array([[1.0, 2.0]]), NONE))
    store.append(WallPoints.of(np.array([[3.0, 4.0]]), np.array([[5.0, 6.0]])))
    assert len(store) == 3
    assert store.since(1).points_m.tolist() == [[3.0, 4.0], [5.0, 6.0]]
    assert store.since(0).inferred.tolist() == [0, 0, 1]
    store.replace(WallPoints.of(np.array([[7.0, 8.0]] * 2), NONE))
    assert store.since(0).points_m.tolist() == [[7.0, 8.0]] * 2


def drive(start: int, count: int) -> Increment:
    keyframes = tuple(
        Keyframe(2.0 * i, Pose2(0.4 * i, 0.0, 0.0), 0.4 * i, 0.4 * i, 0.0, 0.0) for i in range(start, start + count)
    )
    echoes = np.array([[i, 0.4 * i, 0.1 * k, 1.0, pi / 2, 1.0] for i in range(start, start + count) for k in range(4)])
    return Increment(keyframes, echoes, np.zeros((0, 6)))


def test_walls_are_drawn_again_from_time_to_time_though_nothing_moved() -> None:
    builder = MapBuilder()
    assert builder.take(drive(0, 5)).walls is None
    keyframes = round(REDRAW_PATH_M / 0.4)
    correction = builder.take(drive(5, keyframes))
    assert correction.walls is not None
    assert correction.grid is None
    echoed = correction.walls.points_m[correction.walls.inferred == 0]
    assert len(echoed) == 4 * (5 + keyframes)
    assert np.abs(echoed[:, 1] - 1.0).max() < 0.01


def test_the_front_end_loads_nothing_of_scipy() -> None:
    lines = (
        "import sys, onboard.mmu.mmu",
        "print(any(name.partition('.')[0] == 'scipy' for name in sys.modules))",
    )
    assert printed_by(*lines) == ["False"]


def test_what_is_imported_on_demand_is_loaded_when_it_is_called() -> None:
    lines = (
        "import sys",
        "from onboard.mmu.on_demand import on_demand",
        "with on_demand('scipy.spatial.distance'):",
        "    from scipy.spatial import cKDTree, distance",
        "print('scipy.spatial.distance' in sys.modules, distance.euclidean([0.0], [2.0]))",
        "print('scipy.spatial.distance' in sys.modules)",
    )
    assert printed_by(*lines) == ["False", "2.0", "True"]


def printed_by(*lines: str) -> list[str]:
    """The words that a program of these lines prints."""
    command = [sys.executable, "-c", "\n".join(lines)]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
