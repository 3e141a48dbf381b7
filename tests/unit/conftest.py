"""What several files of tests share."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from common.messages.health import Status
from common.messages.mapping import Trajectory
from common.messages.mission import Outcome
from common.messages.motion import Ranges
from common.messages.topics import MAP, PLAN, POI, POSE, RANGES, STATUS, TRAJECTORY
from offboard.evaluate.summary import RunFacts, StepTimes, write_summary
from tests.unit.test_recorder import Run, door, map_update, pose, view


def record_run(folder: Path) -> None:
    """A short run as recorder and simulation leave it, with every file that a run can have."""
    run = Run(folder)
    for k in range(40):
        run.robot.publish(POSE, pose(0.1 * k, 0.02 * k))
        run.robot.publish(RANGES, Ranges(0.1 * k, (1.0, 2.0, float("nan"), 2.0, 1.0), (0.0,) * 5))
    run.robot.publish(STATUS["mmu"], Status(1.0, "running", 0, 1000, True, 1))
    run.robot.publish(TRAJECTORY, Trajectory(4.0, np.arange(3.0), np.zeros((3, 3))))
    run.say(MAP, map_update(0, [0.1 * k for k in range(60)]))
    run.say(POI, door(1, "101", b"jpeg"), door(2, "102"))
    run.say(PLAN, view(finished=True))
    run.recorder.close()
    facts = RunFacts("office", 1, 0, {}, Outcome.FINISHED, "home", 4.0, 1.0, {"mmu": StepTimes.of([0.001])})
    write_summary(folder, facts)
    summary = json.loads((folder / "summary.json").read_text())
    figures = {"coverage": 0.9, "map_rmse_m": 0.05, "home_m": 0.1, "ate_fit_m": None}
    (folder / "summary.json").write_text(json.dumps(summary | figures))


@pytest.fixture(scope="session")
def sound_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a short run, which nobody may change."""
    folder = tmp_path_factory.mktemp("sound") / "run"
    record_run(folder)
    return folder


@pytest.fixture
def recorded_run(sound_run: Path, tmp_path: Path) -> Path:
    """A copy of it: whoever reads a database leaves files beside it."""
    return Path(shutil.copytree(sound_run, tmp_path / "recorded"))
