"""The units of a BeagleBone in a booted systemd: start, order, watchdog, restart, stop. A minute, and once another
for the root folder."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace

import pytest

from common.config import Config
from deploy.boards.layout import CURRENT, STATE, TARGET, UNITS, USER, unit_name
from deploy.boards.tree import assemble
from deploy.boards.units import WATCHDOG_S
from tests.system.container import Container
from tests.system.debian import CACHE, debian_root, need

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]
BRIDGE, SHARED = unit_name("bridge"), unit_name("comm+mmu+planner")
PACKAGES = ("systemd-sysv", "dbus", "python3")


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Container]:
    need("systemd-nspawn=systemd-container", "nsenter=util-linux", "ip=iproute2")
    config = Config()
    config = replace(config, beaglebone=replace(config.beaglebone, platform=os.uname().machine))
    made = assemble(config, ["beaglebone"], CACHE, print)["beaglebone"]
    shown = {made.own / "app": f"{CURRENT}/app", made.site: f"{CURRENT}/site"}
    shown[made.own / "robot.toml"] = f"{CURRENT}/robot.toml"
    shown |= {unit: f"{UNITS}/{unit.name}" for unit in (made.own / "units").iterdir()}
    with closing(Container(debian_root("amd64", "bookworm", PACKAGES), shown)) as container:
        container.ok("useradd", "--system", USER)
        container.ok("systemctl", "start", TARGET)
        yield container
        print(container.journal()[-6000:])


def main_pid(board: Container, unit: str) -> str:
    return board.of_unit(unit, "MainPID")


def hit(board: Container, unit: str, signal: str) -> None:
    board.ok("systemctl", "kill", "--kill-whom=main", f"--signal={signal}", unit)


def test_all_processes_start_bridge_first(board: Container) -> None:
    assert board.of_unit(BRIDGE, "ActiveState") == board.of_unit(SHARED, "ActiveState") == "active"
    ready_us, begun_us = (
        int(board.of_unit(BRIDGE, "ActiveEnterTimestampMonotonic")),
        int(board.of_unit(SHARED, "ExecMainStartTimestampMonotonic")),
    )
    assert ready_us < begun_us
    assert "bridge started" in board.journal()  # what the programs log is in the journal


def test_a_process_whose_loops_step_is_left_alone(board: Container) -> None:
    pids = [main_pid(board, unit) for unit in (BRIDGE, SHARED)]
    board.ok("sleep", str(2.5 * WATCHDOG_S))
    assert [main_pid(board, unit) for unit in (BRIDGE, SHARED)] == pids


@pytest.mark.parametrize("unit", [BRIDGE, SHARED])
def test_a_hung_process_is_restarted_by_its_watchdog(board: Container, unit: str) -> None:
    pid, restarts = main_pid(board, unit), int(board.of_unit(unit, "NRestarts"))
    hit(board, unit, "STOP")
    took_s = board.until_unit(unit, "NRestarts", lambda n: int(n) == restarts + 1, 4 * WATCHDOG_S)
    board.until_unit(unit, "ActiveState", "active".__eq__, 30.0)
    assert took_s > WATCHDOG_S / 2
    assert main_pid(board, unit) != pid
    assert f"{unit}: Watchdog timeout" in board.journal()


@pytest.mark.parametrize("unit", [BRIDGE, SHARED])
def test_a_process_that_is_killed_comes_back(board: Container, unit: str) -> None:
    pid = main_pid(board, unit)
    hit(board, unit, "KILL")
    board.until_unit(unit, "MainPID", lambda new: new not in ("0", pid), 10.0)
    board.until_unit(unit, "ActiveState", "active".__eq__, 30.0)


def test_stop_leaves_nothing_behind_but_what_must_outlive_it(board: Container) -> None:
    board.ok("systemctl", "stop", TARGET)
    # Who stops the target does not wait for its parts
    for unit in (BRIDGE, SHARED):
        board.until_unit(unit, "ActiveState", "inactive".__eq__, 10.0)
    assert board.ok("find", "/proc", "-maxdepth", "1", "-user", USER) == ""
    assert board.ok("find", "/dev/shm", "/tmp", "-user", USER) == ""
    assert f"{STATE}/stop_record.json" in board.ok("find", STATE)
    ending = board.journal().rpartition("Stopped target")[2]
    assert "Deactivated successfully" in ending
    assert "ERROR" not in ending
    board.ok("systemctl", "start", TARGET)
    assert board.of_unit(SHARED, "ActiveState") == "active"
