"""Releases of the robot's real programs in a booted systemd: switched to, returned from, gone back to. Two minutes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace

import pytest

from deploy.boards import layout
from deploy.boards.bootstrap import bootstrap
from deploy.boards.release import LAST_GOOD, Outcome, deliver, switch
from deploy.boards.services import show_logs, start, stop
from deploy.boards.tree import Tree, assemble
from tests.system.container import Container
from tests.system.debian import CACHE, debian_root, need
from tests.system.inside import CONFIG, PACKAGES, Inside

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]


@pytest.fixture(scope="module")
def board() -> Iterator[Inside]:
    need("systemd-nspawn=systemd-container", "nsenter=util-linux", "ip=iproute2")
    with closing(Container(debian_root("amd64", "bookworm", PACKAGES), {})) as container:
        inside = Inside(container)
        bootstrap(inside, CONFIG, replace(inside.facts(), missing_packages=()), None)
        yield inside
        print(container.journal()[-4000:])


@pytest.fixture(scope="module")
def tree() -> Tree:
    return assemble(CONFIG, ["beaglebone"], CACHE, print)["beaglebone"]


def changed(board: Inside, tree: Tree, name: str, words: str) -> None:
    """A release on the board beside that of the tree, changed by `words` in its folder."""
    board.run(f"cd {layout.RELEASES} && cp -a {tree.release} {name} && rm -f {name}/.ok && cd {name} && {words}")


def test_a_release_is_switched_to_and_a_broken_one_returned_from(board: Inside, tree: Tree) -> None:
    deliver(board, tree)
    first = switch(board, tree.release)
    assert first.outcome is Outcome.RUNS, first.text
    assert board.facts().runs(tree.release)
    # Its programs end at once
    changed(board, tree, "ends", "rm -r app/onboard")
    ended = switch(board, "ends")
    assert ended.outcome is Outcome.RETURNED
    assert ended.text.endswith(f"returned to {tree.release}")
    assert board.facts().runs(tree.release)
    # It starts, and ends soon after: too soon to be good
    unit = "units/indoor-mapping-bridge.service"
    changed(board, tree, "fades", f"sed -i -e 's/^ExecStart=.*/ExecStart=sleep 1/' -e 's/notify/simple/' {unit}")
    faded = switch(board, "fades")
    assert faded.outcome is Outcome.RETURNED, faded.text
    assert board.facts().runs(tree.release)
    # What a broken release left of restarts does not count against the good one
    assert all(restarts == "0" for _, restarts in board.facts().units.values())


def test_one_goes_back_to_the_release_before_with_the_units_that_it_had(board: Inside, tree: Tree) -> None:
    more = "indoor-mapping-more.service"
    changed(board, tree, "next", f"printf '[Service]\\nExecStart=sleep 1000\\n' > units/{more}")
    board.run(f"sed -i 's/^Wants=/&{more} /' {layout.RELEASES}/next/units/*.target")
    assert switch(board, "next").outcome is Outcome.RUNS
    assert more in board.run(f"ls {layout.UNITS}")
    assert switch(board, LAST_GOOD).text == tree.release
    assert board.facts().runs(tree.release)
    assert more not in board.run(f"ls {layout.UNITS}")


def test_the_services_are_stopped_and_started_and_their_log_is_shown(board: Inside, tree: Tree) -> None:
    stop(board)
    assert {state for state, _ in board.facts().units.values()} == {"inactive"}
    assert board.facts().permit == ""
    start(board)
    assert board.facts().runs(tree.release)
    assert board.facts().permit == "withheld"
    shown: list[str] = []
    assert show_logs([board], 100, follow=False, show=shown.append) == 0
    assert any("bridge started" in line for line in shown)
