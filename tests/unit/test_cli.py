"""The command line loads what its verb needs, and no more."""

from __future__ import annotations

import argparse
import importlib
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from deploy.cli import FAMILIES, build_parser, main, no_options
from tests.architecture.project import ROOT

HEAVY = {"scipy", "cv2", "mujoco", "shapely", "textual", "filterpy", "onnxruntime", "starlette"}


@pytest.mark.parametrize("family", FAMILIES)
def test_a_family_adds_the_verbs_by_which_it_is_found(family: str) -> None:
    verbs = argparse.ArgumentParser().add_subparsers()
    importlib.import_module(f"deploy.verbs.{family}").add_verbs(verbs)
    assert tuple(verbs.choices) == FAMILIES[family]


@pytest.mark.parametrize("verb", ["estop", "release", "pause"])
def test_a_verb_that_stops_the_robot_loads_no_heavy_library(verb: str) -> None:
    program = (
        "import sys\n"
        "from deploy.cli import main\n"
        f"main([{verb!r}, '--config', '/nowhere/robot.toml'])\n"
        "print(*{name.partition('.')[0] for name in sys.modules})\n"
    )
    shown = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    loaded = set(shown.stdout.split())
    assert "zenoh" in loaded
    assert loaded & HEAVY == set()
    assert ("numpy" in loaded) is (verb != "estop")


@pytest.mark.parametrize("place", ["-3,1", "-3.5,-1", "-.5,2", "3,-1"])
def test_a_place_may_begin_with_a_minus(place: str) -> None:
    words = no_options(["goto", place, "--config", "robot.toml"])
    arguments = build_parser(("operator",)).parse_args(words)
    assert arguments.place.strip() == place
    assert arguments.config == Path("robot.toml")


def test_options_stay_options() -> None:
    assert no_options(["-h", "--beams", "-45,0,45", "--", "-x"]) == ["-h", "--beams", " -45,0,45", "--", "-x"]


@pytest.mark.parametrize(
    "words", [["local", "--out", ""], ["runs", ""], ["export", "run", "--to", " "], ["estop", "--config", ""]]
)
def test_an_empty_name_is_no_folder(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(words)
    assert left.value.code == 2
    assert "must name a file or folder, and is empty" in capsys.readouterr().err


def test_a_door_of_nobody_knows_which_run_is_told_as_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["goto", "106"]) == 2
    told = capsys.readouterr().err
    assert "--run-dir" in told
    assert "no number was read yet" not in told


@pytest.mark.parametrize("library", ["_multiarray_umath", "zenoh", ""])
def test_an_interrupt_while_a_verb_loads_ends_it_without_a_traceback(library: str, tmp_path: Path) -> None:
    """As soon as a library is there, of which others follow; the last time once the run has begun."""
    words = ["local", "--headless", "--floor", "straight", "--out", str(tmp_path / "run")]
    command, pipe = [sys.executable, "-m", "deploy", *words], subprocess.PIPE
    process = subprocess.Popen(command, cwd=ROOT, stdout=pipe, stderr=pipe, text=True)
    maps, log = Path(f"/proc/{process.pid}/maps"), tmp_path / "run" / "process" / "local.log"
    while not (library in maps.read_text() if library else log.exists()):
        assert process.poll() is None
        time.sleep(0.001)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=60.0)
    assert "Traceback" not in told
    assert process.returncode == 130


@pytest.mark.parametrize("pose", ["3,1", "3,1,north", "3,1,nan", "1,2,3,4"])
def test_a_pose_is_two_coordinates_and_a_heading(pose: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["pose", pose, "--config", "/nowhere/robot.toml"]) == 2
    assert "is no pose: X,Y in metres and HEADING in degrees" in capsys.readouterr().err
