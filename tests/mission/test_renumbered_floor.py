"""A floor whose plates have numbers of another form: the robot reads all, and learns the form where nobody names it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from common.errors import StartError
from offboard.simulator.run.lockstep import simulate
from offboard.simulator.run.options import FLOORS, RunOptions


def renumbered(folder: Path, form: str) -> Path:
    """The project's floor "straight" with other numbers on its plates."""
    floor = json.loads((FLOORS / "straight.json").read_text(encoding="utf-8"))
    for i, door in enumerate(floor["doors"], start=1):
        door["number"] = form.format(i)
    path = folder / "renumbered.json"
    path.write_text(json.dumps(floor), encoding="utf-8")
    return path


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.requirement("POI_MR_01", "POI_MR_02")
@pytest.mark.parametrize(
    ("form", "toml"),
    [
        ("16-1{:02}", ""),
        ("16-1{:02}", '[poi]\nnumber_presets = ["building-room"]'),
        ("2.{:02}", '[poi]\nnumber_presets = ["floor.room"]'),
        ("S1|{:02}", '[poi]\nnumber_presets = ["building|room"]'),
        ("A-2-{:02}", '[poi]\nnumber_pattern = "[A-Z]-[0-9]-[0-9]{2}"'),
    ],
)
def test_robot_reads_every_plate_of_a_renumbered_floor(form: str, toml: str, tmp_path: Path) -> None:
    """A whole mission, some minutes each."""
    config = tmp_path / "robot.toml"
    config.write_text(toml, encoding="utf-8")
    options = RunOptions(renumbered(tmp_path, form), seed=1, camera="realistic", out=tmp_path / "run", config=config)
    try:
        assert simulate(options) == 0
    except StartError as error:
        pytest.skip(str(error))
    summary = json.loads((tmp_path / "run" / "summary.json").read_text(encoding="utf-8"))
    assert summary["doors"] > 0
    assert summary["numbers_shown"] == summary["doors"]
    pois = json.loads((tmp_path / "run" / "pois.json").read_text(encoding="utf-8"))
    assert {poi["state"] for poi in pois if poi["number"]} == {"read"}
