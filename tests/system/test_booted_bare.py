"""A bare board without a network, and a power cut in the middle of an update, in a booted systemd. Two minutes."""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path

import pytest

from common.errors import StartError
from deploy.boards import checks, fleet, layout
from deploy.boards.bootstrap import bootstrap
from deploy.boards.fleet import Fleet
from deploy.boards.release import Outcome, deliver, switch
from deploy.boards.tree import Tree, assemble, debian_packages
from tests.system.conftest import ROOT, until
from tests.system.container import Container
from tests.system.debian import CACHE, debian_root, need, over
from tests.system.inside import CONFIG, PACKAGES, Inside

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]
CHAPTER = ROOT / "docs" / "deployment.md"
DEBIAN = 12
UNIT = "units/indoor-mapping-bridge.service"


@pytest.fixture(scope="module")
def root() -> Path:
    need("systemd-nspawn=systemd-container", "nsenter=util-linux", "ip=iproute2")
    return debian_root("amd64", "bookworm", PACKAGES)


@pytest.fixture(scope="module")
def debs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the lines of the chapter fetch; they are for a machine of the board's Debian."""
    if f'VERSION_ID="{DEBIAN}"' not in Path("/etc/os-release").read_text(encoding="utf-8"):
        pytest.skip(f"needs a machine with Debian {DEBIAN}")
    folder = tmp_path_factory.mktemp("fetched")
    text = CHAPTER.read_text(encoding="utf-8").partition("**Without a network on the boards**")[2]
    lines = text.partition("```\n")[2].partition("```")[0]
    assert set(debian_packages(CONFIG, "beaglebone")) <= set(lines.split())
    subprocess.run(["sh", "-ec", lines], cwd=folder, check=True, capture_output=True)
    return folder / "debs"


def test_a_board_without_a_network_is_prepared_from_packages_that_are_carried_over(root: Path, debs: Path) -> None:
    with closing(Container(root, {})) as container:
        board = Inside(container)
        facts = board.facts()
        assert set(facts.missing_packages) == {"rsync", "avrdude"}
        with pytest.raises(StartError, match=r"give a folder of \.deb files with --debs"):
            bootstrap(board, CONFIG, facts, None)
        bootstrap(board, CONFIG, facts, debs)
        assert checks.board_problems(CONFIG, "beaglebone", board.facts()) == ["beaglebone has no /dev/ttyACM0."]
        assert "avrdude version" in container.run("avrdude", "-?").stderr
        # The folder has more than the board lacks, which is left alone
        assert container.run("dpkg-query", "-W", "python3-scipy").returncode != 0
        container.ok("dpkg", "--purge", "avrdude")
        with pytest.raises(StartError, match="beaglebone: E: Unable to locate package avrdude"):
            bootstrap(board, CONFIG, board.facts(), only(debs, "rsync_*.deb"))


def only(debs: Path, pattern: str) -> Path:
    """A folder with some of the packages."""
    folder = debs / "some"
    folder.mkdir()
    for deb in debs.glob(pattern):
        (folder / deb.name).symlink_to(deb)
    return folder


@pytest.fixture
def disk(root: Path, tmp_path: Path) -> Iterator[Path]:
    """Of a board that is switched off and on."""
    with over(root, tmp_path) as merged:
        yield merged


def switch_and_cut_power(container: Container, release: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The board has begun with the release, and its health is not known yet."""
    board = Inside(container)
    monkeypatch.setattr("deploy.boards.release.HEALTHY_S", 600.0)

    def begin() -> None:
        with suppress(StartError):
            switch(board, release)

    switching = threading.Thread(target=begin)
    switching.start()
    until(lambda: board.facts().release == release, 60.0, "the switch")
    container.cut_power()
    switching.join()
    monkeypatch.undo()


def test_after_a_power_cut_in_an_update_the_board_is_reachable_tells_of_it_and_goes_back_or_on(
    disk: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tree: Tree = assemble(CONFIG, ["beaglebone"], CACHE, print)["beaglebone"]
    copied = f"cd {layout.RELEASES} && cp -a {tree.release} {{0}} && rm {{0}}/.ok && cd {{0}}"
    with closing(Container(disk, {}, keeps=True)) as container:
        board = Inside(container)
        bootstrap(board, CONFIG, replace(board.facts(), missing_packages=()), None)
        deliver(board, tree)
        assert switch(board, tree.release).outcome is Outcome.RUNS
        board.run(
            f"{copied.format('fades')} && sed -i -e 's/^ExecStart=.*/ExecStart=sleep 1/' -e 's/notify/simple/' {UNIT}"
        )
        switch_and_cut_power(container, "fades", monkeypatch)
    with closing(Container(disk, {}, keeps=True)) as container:
        board = Inside(container)
        facts = board.facts()
        (told,) = checks.release_problems({"beaglebone": facts})
        assert told.startswith("beaglebone was switched to fades and not seen to run well since")
        robot = Fleet(CONFIG, {"beaglebone": board}, ("beaglebone",))
        assert fleet.go_back(robot)
        assert board.facts().runs(tree.release)
        assert checks.release_problems({"beaglebone": board.facts()}) == []
        board.run(copied.format("sound"))
        # And onwards: a sound release that was cut off is switched to again, and is good then
        switch_and_cut_power(container, "sound", monkeypatch)
    with closing(Container(disk, {}, keeps=True)) as container:
        board = Inside(container)
        until(lambda: board.facts().runs("sound"), 60.0, "the release that the board was switched to")
        assert len(checks.release_problems({"beaglebone": board.facts()})) == 1
        assert switch(board, "sound").outcome is Outcome.RUNS
        assert checks.release_problems({"beaglebone": board.facts()}) == []
