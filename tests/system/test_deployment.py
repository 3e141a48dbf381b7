"""`deploy` onto boards behind ssh: what it sends, what it refuses, and what runs afterwards whatever goes wrong.

The slow ones take half a minute each on a machine that does nothing else.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from common.config import BoardSection, Config
from common.errors import StartError
from deploy.boards import fleet, layout, release, services, ssh
from deploy.boards.bootstrap import bootstrap
from deploy.boards.fleet import Fleet, Refused, open_fleet
from deploy.boards.probe import Facts, probe
from deploy.boards.release import deliver
from deploy.boards.ssh import Unreachable
from deploy.boards.tree import Tree
from tests.system.board_machine import BoardMachine, board_machines
from tests.system.conftest import until

pytestmark = pytest.mark.timeout(120)
PLATFORM = os.uname().machine
UNIT = """[Service]
ExecStart=/bin/sh /opt/indoor-mapping/current/app/service.sh
"""
RUNS, ENDS = "echo it runs; exec sleep 1000\n", "echo it cannot run; exit 1\n"


def board(name: str, *processes: str) -> BoardSection:
    return BoardSection(processes, ssh=name, platform=PLATFORM)


CONFIG = Config(
    beaglebone=board("board-a", "bridge", "comm+mmu+planner"), raspberry=BoardSection(("poi",), platform=PLATFORM)
)
CONFIG = replace(
    CONFIG, poi=replace(CONFIG.poi, source="unix:frames"), bridge=replace(CONFIG.bridge, serial_port="/dev/null")
)
BOTH = replace(CONFIG, raspberry=board("board-b", "poi"))


@pytest.fixture(autouse=True)
def _short_watch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(release, "HEALTHY_S", 0.3)
    monkeypatch.setattr(ssh, "ALIVE_S", 1)
    monkeypatch.setattr(ssh, "CONNECT_S", 3)


class Laptop:
    """Makes trees, and keeps what was reported."""

    def __init__(self, folder: Path, config: Config) -> None:
        self.folder, self.config = folder, config
        self.lines: list[str] = []

    def tree(self, name: str, service: str = RUNS, size_bytes: int = 300_000, processes: tuple[str, ...] = ()) -> Tree:
        """A release whose services all do the same."""
        own, site = self.folder / name, self.folder / "site"
        (own / "app").mkdir(parents=True)
        (own / "units").mkdir()
        (own / "app" / "service.sh").write_text(service)
        names = [layout.unit_name(process) for process in processes or self.config.beaglebone.processes]
        for unit in names:
            (own / "units" / unit).write_text(UNIT)
        (own / "units" / layout.TARGET).write_text(f"[Unit]\nWants={' '.join(names)}\n")
        if not site.exists():
            site.mkdir()
            (site / "package.py").write_bytes(os.urandom(size_bytes))
        return Tree(name, own, site)

    @contextmanager
    def fleet(self, *boards: str, dry_run: bool = False) -> Iterator[Fleet]:
        with open_fleet(self.config, boards, self.lines.append, dry_run=dry_run) as opened:
            yield opened

    def push(self, tree: Tree, *boards: str, **trees: Tree) -> bool:
        with self.fleet(*boards) as opened:
            return fleet.push(opened, dict.fromkeys(opened.chosen, tree) | trees)

    def prepare(self) -> None:
        with self.fleet() as opened:
            for connection in opened.each():
                bootstrap(connection, self.config, probe(connection, self.config), None)

    def facts(self, name: str = "beaglebone") -> Facts:
        with self.fleet(name) as opened:
            return probe(opened.connections[name], self.config)


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[BoardMachine]:
    with board_machines(tmp_path, monkeypatch, "board-a") as machines:
        yield machines[0]


@pytest.fixture
def laptop(tmp_path: Path, machine: BoardMachine) -> Laptop:
    """Before a board that is prepared."""
    made = Laptop(tmp_path, CONFIG)
    made.prepare()
    return made


def services_of(facts: Facts) -> set[str]:
    return {state for state, _ in facts.units.values()}


def running(facts: Facts) -> str:
    """The release, if all of its services run."""
    return facts.release if services_of(facts) == {"active"} else ""


def test_a_bare_board_is_prepared_and_a_second_push_of_the_same_sends_almost_nothing(
    tmp_path: Path, machine: BoardMachine
) -> None:
    laptop = Laptop(tmp_path, CONFIG)
    machine.run("echo avrdude > /etc/board_missing")
    with pytest.raises(Refused, match="beaglebone is not prepared: run `deploy bootstrap`"):
        laptop.push(laptop.tree("r1"))
    laptop.prepare()
    assert "install -qq -y --no-install-recommends avrdude" in machine.run("cat /etc/board_apt")
    assert machine.run("id -un indoor-mapping").strip() == "indoor-mapping"
    first = laptop.tree("r2")
    assert laptop.push(first)
    assert running(laptop.facts()) == "r2"
    with laptop.fleet() as opened:
        connection = opened.connections["beaglebone"]
        again = deliver(connection, replace(first, release="r3"))
        assert again < 3_000, f"{again} of {first.size_bytes()} bytes were sent"
        services.show_logs([connection], 10, follow=False, show=laptop.lines.append)
        services.stop(connection)
    assert "beaglebone: it runs" in laptop.lines
    assert "active" not in services_of(laptop.facts())


def test_a_broken_release_goes_back_by_itself_and_rollback_leads_to_the_one_before(laptop: Laptop) -> None:
    assert laptop.push(laptop.tree("good1"))
    assert laptop.push(laptop.tree("good2"))
    assert not laptop.push(laptop.tree("broken", ENDS))
    assert "beaglebone: Job for" in laptop.lines[-1]
    assert laptop.lines[-1].endswith("returned to good2.")
    assert running(laptop.facts()) == "good2"
    with laptop.fleet() as opened:
        assert fleet.go_back(opened)
    assert running(laptop.facts()) == "good1"


@pytest.mark.slow
def test_a_first_release_that_is_broken_leaves_nothing_running(laptop: Laptop) -> None:
    assert not laptop.push(laptop.tree("broken", ENDS))
    assert laptop.lines[-1].endswith("no other release ran well, so nothing runs.")
    assert "active" not in services_of(laptop.facts())
    with laptop.fleet() as opened, pytest.raises(Refused, match="no earlier release that ran well on beaglebone"):
        fleet.go_back(opened)


@pytest.mark.slow
def test_a_link_that_breaks_in_the_middle_leaves_the_old_release_running(laptop: Laptop, machine: BoardMachine) -> None:
    assert laptop.push(laptop.tree("old"))
    new = laptop.tree("new")
    (new.own / "app" / "large").write_bytes(os.urandom(30_000_000))
    machine.link.delay_s = 0.01

    def cut() -> None:
        until(lambda: any("sending new" in line for line in laptop.lines))
        time.sleep(0.5)
        machine.link.up = False

    cutter = threading.Thread(target=cut)
    cutter.start()
    with pytest.raises(Unreachable, match="The link to beaglebone broke while it was sent new"):
        laptop.push(new)
    cutter.join()
    machine.link.up, machine.link.delay_s = True, 0.0
    until(lambda: running(laptop.facts()) == "old", 20.0)
    assert machine.run(f"ls {layout.RELEASES}").split() == ["new.part", "old"]
    assert laptop.push(new)
    assert laptop.facts().release == "new"


@pytest.mark.slow
def test_a_full_disk_is_seen_before_anything_is_sent_and_survived_when_it_fills_meanwhile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with board_machines(tmp_path, monkeypatch, "board-a", opt_mb=20) as (machine,):
        laptop = Laptop(tmp_path, CONFIG)
        laptop.prepare()
        assert laptop.push(laptop.tree("old"))
        new = laptop.tree("new")
        (new.own / "app" / "large").write_bytes(os.urandom(24_000_000))
        with pytest.raises(Refused, match=r"beaglebone has \d+ MB free, and the release needs 5\d MB"):
            laptop.push(new)
        assert machine.run(f"ls {layout.RELEASES}").split() == ["old"]
        monkeypatch.setattr(fleet, "needed_bytes", lambda *_: 0)
        with pytest.raises(StartError, match=r"beaglebone did not take new: .*No space left on device"):
            laptop.push(new)
        assert running(laptop.facts()) == "old"
        monkeypatch.undo()


def test_another_python_or_platform_is_refused_before_anything_is_sent(laptop: Laptop, machine: BoardMachine) -> None:
    new = laptop.tree("r1")
    for change, complaint in (
        ({"platform": "armv7l"}, f"beaglebone is {PLATFORM}; "),
        ({"debian": 13}, r"/usr/bin/python3 of beaglebone is 3\.11; Debian 13 has 3\.13"),
    ):
        laptop.config = replace(CONFIG, beaglebone=replace(CONFIG.beaglebone, **change))  # type: ignore[arg-type]
        with pytest.raises(Refused, match=complaint):
            laptop.push(new)
    assert machine.run(f"ls {layout.RELEASES}") == ""


@pytest.mark.slow
def test_nothing_changes_while_the_robot_may_move(laptop: Laptop, machine: BoardMachine) -> None:
    assert laptop.push(laptop.tree("old"))
    machine.run(f"mkdir -p {layout.RUNTIME}; echo granted > {layout.RUNTIME}/permit")
    changes: list[Callable[[Fleet], object]] = [
        lambda f: fleet.push(f, {"beaglebone": laptop.tree("new")}),
        fleet.go_back,
    ]
    for change in changes:
        with laptop.fleet() as opened, pytest.raises(Refused, match="The robot may move: stop it first with `estop`"):
            change(opened)
    machine.run(f"echo withheld > {layout.RUNTIME}/permit")
    with laptop.fleet() as opened:
        opened.refuse_while_moving()


def test_a_dry_run_shows_every_step_and_does_none(laptop: Laptop, machine: BoardMachine) -> None:
    with laptop.fleet(dry_run=True) as opened:
        assert fleet.push(opened, {"beaglebone": laptop.tree("r1")})
    assert any("would run: compile it, then name it r1" in line for line in laptop.lines)
    assert any("would switch to r1" in line for line in laptop.lines)
    assert machine.run(f"ls {layout.RELEASES}") == ""


@pytest.mark.slow
def test_of_two_boards_one_away_stops_a_push_before_it_begins_and_one_broken_takes_the_other_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with board_machines(tmp_path, monkeypatch, "board-a", "board-b") as (beaglebone, raspberry):
        laptop = Laptop(tmp_path, BOTH)
        laptop.prepare()
        assert laptop.push(laptop.tree("r1"), raspberry=laptop.tree("r1-pi", processes=("poi",)))
        assert [line for line in laptop.lines if "runs r1" in line] == ["raspberry: runs r1-pi", "beaglebone: runs r1"]
        # The board of comm comes last: when it fails, the other one goes back
        broken, new = laptop.tree("r2", ENDS), laptop.tree("r2-pi", processes=("poi",))
        assert not laptop.push(broken, raspberry=new)
        assert laptop.lines[-1] == "raspberry: runs r1-pi again"
        assert (laptop.facts().release, laptop.facts("raspberry").release) == ("r1", "r1-pi")
        raspberry.link.up = False
        with pytest.raises(Refused, match=r"raspberry .*cannot be reached by ssh"):
            laptop.push(laptop.tree("r3"), raspberry=new)
        assert machine_is_untouched(beaglebone)
        with laptop.fleet() as opened:
            answers = opened.answers()
        assert isinstance(answers["beaglebone"], Facts)
        assert isinstance(answers["raspberry"], Unreachable)


def machine_is_untouched(machine: BoardMachine) -> bool:
    return "r3" not in machine.run(f"ls {layout.RELEASES}")
