"""Boards of different releases, and updates that end half-way: the wheels stay off, and a person gets out of it. Six
minutes."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from deploy.boards.tree import PACKAGES
from tests.system.conftest import ROOT, environment
from tests.system.deployed_robot import DeployedRobot, deployed_robot

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1500)]
FIELD = '    photo_jpeg: Photo = b""\n'


@pytest.fixture(scope="module")
def newer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sources of another release, whose points of interest have a field more."""
    folder = tmp_path_factory.mktemp("newer")
    for package in PACKAGES:
        shutil.copytree(ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__"))
    for file in ("pyproject.toml", "constraints.txt"):
        shutil.copy2(ROOT / file, folder / file)
    messages = folder / "common" / "messages" / "points_of_interest.py"
    text = messages.read_text(encoding="utf-8")
    assert text.count(FIELD) == 1
    messages.write_text(text.replace(FIELD, f'{FIELD}    storey: Word = ""\n'), encoding="utf-8")
    return folder


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[DeployedRobot]:
    """It drives, then a person stops it, as one does before an update."""
    with deployed_robot(tmp_path, monkeypatch) as made:
        made.deploy("bootstrap")
        made.deploy("push")
        made.start_laptop()
        made.drive()
        made.press()
        yield made


def release_on(robot: DeployedRobot, board: str) -> str:
    shown = robot.deploy("status", "--board", board)
    return shown.partition("release ")[2].partition(",")[0]


def assert_refused(robot: DeployedRobot, poi: str, comm: str) -> None:
    """One sentence names both, and no order moves the wheels."""
    assert robot.stands_whatever_is_asked(10.0)
    assert robot.permit_reason == f"poi runs release {poi}, comm release {comm}"
    told = f"The boards have different releases: raspberry runs {poi}, beaglebone runs {comm}"
    assert told in robot.deploy("status", fails=True)


def test_boards_of_different_releases_refuse_each_other_until_a_push_has_brought_both_up_to_date(
    robot: DeployedRobot, newer: Path
) -> None:
    old = release_on(robot, "beaglebone")
    print(robot.deploy("push", "--board", "raspberry", root=newer))
    new = release_on(robot, "raspberry")
    assert new != old
    assert_refused(robot, new, old)
    print(robot.permit_reason)
    pushed = robot.deploy("push", root=newer)
    print(pushed)
    assert f"raspberry: runs {new} already" in pushed
    assert f"beaglebone: runs {new}" in pushed
    robot.drive()


@contextmanager
def push_without_beaglebone(robot: DeployedRobot, newer: Path) -> Iterator[tuple[subprocess.Popen[str], Iterator[str]]]:
    """A push and its lines; the BeagleBone's cable is out from the moment on at which the Raspberry Pi switches."""
    command = [sys.executable, "-m", "deploy.cli", "deploy", "push", "--config", str(robot.config_file)]
    with subprocess.Popen(
        command, cwd=newer, env=environment() | {"PYTHONPATH": str(newer)},
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True,
    ) as push:  # fmt: skip
        stdout = push.stdout
        assert stdout is not None

        def lines() -> Iterator[str]:
            for line in stdout:
                print(line.rstrip())
                robot.beaglebone.link.up &= line != "raspberry: switching ...\n"
                yield line

        yield push, lines()
    robot.beaglebone.link.up = True


def push_dies_between_boards(robot: DeployedRobot, newer: Path) -> None:
    """The Raspberry Pi has switched; then the laptop is gone, and the BeagleBone has heard nothing of it."""
    with push_without_beaglebone(robot, newer) as (push, lines):
        for line in lines:
            if line.startswith("raspberry: runs "):
                os.killpg(push.pid, signal.SIGKILL)
    assert push.returncode == -signal.SIGKILL


def test_a_push_that_dies_between_the_boards_leaves_a_robot_that_stands_and_is_rolled_back(
    robot: DeployedRobot, newer: Path
) -> None:
    old = release_on(robot, "beaglebone")
    push_dies_between_boards(robot, newer)
    new = release_on(robot, "raspberry")
    assert release_on(robot, "beaglebone") == old
    assert_refused(robot, new, old)
    back = robot.deploy("rollback")
    print(back)
    assert f"raspberry: runs {old}" in back
    assert f"beaglebone: runs {old} already" in back
    assert [release_on(robot, board) for board in ("raspberry", "beaglebone")] == [old, old]
    robot.drive()
    # The same again, and this time onwards
    robot.press()
    push_dies_between_boards(robot, newer)
    assert_refused(robot, new, old)
    robot.deploy("push", root=newer)
    robot.drive()


def test_a_push_whose_second_board_is_gone_takes_the_first_one_back(robot: DeployedRobot, newer: Path) -> None:
    old = release_on(robot, "beaglebone")
    with push_without_beaglebone(robot, newer) as (push, lines):
        said = list(lines)
    assert push.returncode == 2
    assert f"raspberry: runs {old} again\n" in said
    assert [release_on(robot, board) for board in ("raspberry", "beaglebone")] == [old, old]
    robot.drive()
