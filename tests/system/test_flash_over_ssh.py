"""`deploy flash` onto a Mega that hangs on a board behind ssh; its bootloader is a stand-in, avrdude is Debian's."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from common.config import BoardSection, BridgeSection, Config
from common.config_file import config_text
from deploy.boards.layout import RUNTIME, UNITS, unit_name
from deploy.cli import main
from onboard.comm.permit_file import GRANTED, NAME, WITHHELD
from tests.system.board_machine import BoardMachine, board_machines
from tests.unit.stk500v2 import Bootloader
from tests.unit.test_flash import content, hex_file

pytestmark = [
    pytest.mark.timeout(120),
    pytest.mark.skipif(shutil.which("avrdude") is None, reason="needs: apt install avrdude"),
]
BRIDGE, COMM = unit_name("bridge"), unit_name("comm+mmu+planner")


@pytest.fixture
def mega() -> Iterator[Bootloader]:
    with closing(Bootloader()) as made:
        yield made


@pytest.fixture
def board(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[BoardMachine]:
    with board_machines(tmp_path, monkeypatch, "board-a") as machines:
        machine = machines[0]
        for unit in (BRIDGE, COMM):
            machine.run(f"printf '[Service]\\nExecStart=/bin/sleep 1000\\n' > {UNITS}/{unit}; systemctl start {unit}")
        permit(machine, WITHHELD)
        yield machine


def permit(board: BoardMachine, word: str) -> None:
    board.run(f"mkdir -p {RUNTIME}; echo -n {word} > {RUNTIME}/{NAME}")


def active(board: BoardMachine, unit: str) -> bool:
    return "yes" in board.run(f"systemctl is-active -q {unit} && echo yes || true")


def words(folder: Path, mega: Bootloader) -> list[str]:
    """Of a robot whose BeagleBone is that board."""
    section = BoardSection(("bridge", "comm+mmu+planner"), ssh="board-a", platform=os.uname().machine)
    config = replace(Config(beaglebone=section), bridge=BridgeSection(serial_port=mega.path))
    (folder / "robot.toml").write_text(config_text(config), encoding="utf-8")
    firmware = hex_file(folder, content(1))
    return ["deploy", "flash", "--config", str(folder / "robot.toml"), "--firmware", str(firmware)]


def test_the_bridge_makes_room_and_comes_back(
    board: BoardMachine, mega: Bootloader, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words(tmp_path, mega)) == 0
    assert bytes(mega.flash[:3_000]) == content(1)
    assert active(board, BRIDGE)
    written = mega.pages_written
    assert main(words(tmp_path, mega)) == 0
    assert mega.pages_written == written
    assert "has this firmware already" in capsys.readouterr().out


def test_a_bridge_that_was_stopped_stays_so(board: BoardMachine, mega: Bootloader, tmp_path: Path) -> None:
    board.run(f"systemctl stop {BRIDGE}")
    assert main(words(tmp_path, mega)) == 0
    assert not active(board, BRIDGE)


def test_while_the_robot_may_move_nothing_is_flashed(
    board: BoardMachine, mega: Bootloader, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    permit(board, GRANTED)
    assert main(words(tmp_path, mega)) == 2
    assert "The robot may move" in capsys.readouterr().err
    assert mega.sessions == 0
    assert active(board, BRIDGE)


def test_a_port_that_is_not_there_is_said_and_the_bridge_comes_back(
    board: BoardMachine, mega: Bootloader, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = words(tmp_path, mega)
    file = tmp_path / "robot.toml"
    file.write_text(file.read_text(encoding="utf-8").replace(mega.path, "/dev/nowhere"), encoding="utf-8")
    assert main(arguments) == 2
    assert "/dev/nowhere is not there" in capsys.readouterr().err
    assert active(board, BRIDGE)
