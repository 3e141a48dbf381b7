"""World, board, line and camera together, as the lockstep and the process "simulator" hold them."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest

from offboard.simulator.building.floor import load_floor
from offboard.simulator.camera import camera as camera_module
from offboard.simulator.electronics.board import FirmwareBuildError, HostBoard
from offboard.simulator.run.simulation import Simulation
from tests.unit.test_simulator_world import RecordingBoard, hall

LOOP = Path(__file__).parents[2] / "offboard" / "simulator" / "floors" / "loop.json"


def test_time_advances_in_whole_steps_and_never_beyond() -> None:
    with Simulation(hall(), RecordingBoard(), errors="none") as simulation:
        simulation.advance(0.1)
        assert simulation.world.time_s == pytest.approx(0.1)
        simulation.advance(0.1024)
        assert simulation.world.time_s == pytest.approx(0.1)
        simulation.advance(0.105)
        assert simulation.world.time_s == pytest.approx(0.105)
        simulation.advance(0.05)
        assert simulation.world.time_s == pytest.approx(0.105)


def test_truth_is_written_on_the_clock_of_the_world(tmp_path: Path) -> None:
    with Simulation(hall(), RecordingBoard(), errors="none") as simulation:
        simulation.advance(1.0)
        simulation.write_truth(tmp_path)
    rows = np.loadtxt(tmp_path / "truth.tum")
    assert rows.shape == (11, 8)
    assert rows[0, 0] == pytest.approx(0.0)
    assert rows[-1, 0] == pytest.approx(1.0)


def test_without_opengl_everything_else_runs(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    monkeypatch.setattr(camera_module, "_LIBRARIES", ())
    with caplog.at_level(logging.WARNING), Simulation(hall(), RecordingBoard(), camera="clean") as simulation:
        assert simulation.camera is None
        simulation.advance(0.2)
    assert "libegl1 libopengl0 libgl1-mesa-dri" in caplog.text


def test_the_real_firmware_speaks_over_the_line_and_a_run_repeats_to_the_bit() -> None:
    try:
        boards = [HostBoard(), HostBoard()]
    except FirmwareBuildError as error:
        pytest.skip(str(error))
    spoken = []
    for board in boards:
        with Simulation(load_floor(LOOP), board, seed=7, errors="harsh") as simulation:
            received = b""
            for step in range(1, 41):
                simulation.advance(step * 0.1)
                received += simulation.port.read()
            spoken.append(received)
    assert b"_ODO," in spoken[0]
    assert b"_RNG," in spoken[0]
    assert spoken[0] == spoken[1]


def test_steps_that_are_made_in_one_go_are_the_same_to_the_bit() -> None:
    logs = []
    for together in (1, 50):
        try:
            board = HostBoard()
        except FirmwareBuildError as error:
            pytest.skip(str(error))
        received, readable_s = b"", []
        with Simulation(load_floor(LOOP), board, seed=3, errors="realistic") as simulation:
            world = simulation.world
            while world.time_s < 6.0:
                done = simulation.run(together)
                assert 1 <= done <= together
                if simulation.port.readable:
                    readable_s.append(round(world.time_s, 3))
                    received += simulation.port.read()
            logs.append((received, readable_s, world.truth_log))
    assert logs[0] == logs[1]
    assert len(logs[0][0]) > 1000
