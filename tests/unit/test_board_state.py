"""What a computer reports of itself, read from files that stand in for the kernel's."""

from __future__ import annotations

from math import isnan
from pathlib import Path

import pytest

from common.board_state import BoardReporter, read_board_state
from common.bus import LocalMesh
from common.constants import BOARD_RATE_HZ
from common.messages.topics import BOARD
from common.release import SOURCES


@pytest.fixture
def kernel(tmp_path: Path) -> Path:
    files = {
        "proc/uptime": "93784.21 180000.00\n",
        "proc/loadavg": "0.42 0.31 0.20 1/123 4567\n",
        "sys/class/thermal/thermal_zone0/temp": "48312\n",
        "sys/class/thermal/thermal_zone1/temp": "51000\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="ascii")
    return tmp_path


def test_uptime_load_hottest_zone_and_free_disk_are_read(kernel: Path) -> None:
    state = read_board_state(5.0, 1_700_000_000.0, kernel, root=kernel)
    assert (state.uptime_s, state.load, state.temperature_c) == (93784.21, 0.42, 51.0)
    assert state.disk_free_mb > 0
    assert (state.t_s, state.wall_s, state.release) == (5.0, 1_700_000_000.0, SOURCES)


def test_a_system_that_reports_nothing_is_no_error(tmp_path: Path) -> None:
    state = read_board_state(5.0, 0.0, tmp_path / "gone", root=tmp_path)
    assert (state.uptime_s, state.load, state.disk_free_mb) == (0.0, 0.0, 0)
    assert isnan(state.temperature_c)


def test_a_report_every_few_seconds_however_often_a_node_steps(tmp_path: Path) -> None:
    mesh = LocalMesh()
    robot, laptop = mesh.endpoint("comm"), mesh.endpoint("command_center")
    laptop.take(BOARD["comm"])
    reporter = BoardReporter("comm", tmp_path, wall_clock=lambda: 1_700_000_000.0)
    for step in range(1001):
        reporter.report(robot, step * 0.02)
    assert len(laptop.take(BOARD["comm"])) == 1 + 20 * BOARD_RATE_HZ
