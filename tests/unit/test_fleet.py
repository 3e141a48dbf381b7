"""All boards of a robot together: what they go back to, and what counts as running, without any board."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace

import pytest

from common.config import Config
from deploy.boards import fleet
from deploy.boards.fleet import Fleet, Refused
from deploy.boards.probe import Facts, parse
from deploy.boards.release import Outcome, Switched
from deploy.boards.ssh import Connection, Unreachable
from onboard.comm.permit_file import GRANTED, WITHHELD

CONFIG = Config(
    beaglebone=replace(Config().beaglebone, ssh="beaglebone"), raspberry=replace(Config().raspberry, ssh="raspberry")
)
UNIT = "indoor-mapping-any.service"


def facts(release: str, *good: str, permit: str = WITHHELD) -> Facts:
    return parse(f"release={release}\ngood={' '.join(good)}\npermit={permit}\nunit:{UNIT}=active 0\n", 0.0)


class Boards:
    """Two of them, the one of comm last; every switch succeeds, and is remembered."""

    def __init__(self, stack: ExitStack, raspberry: Facts | Unreachable, beaglebone: Facts | Unreachable) -> None:
        self.answers = {"raspberry": raspberry, "beaglebone": beaglebone}
        self.lines: list[str] = []
        self.switched: list[tuple[str, str]] = []
        connections = {
            board: stack.enter_context(Connection(board, board, self.lines.append)) for board in self.answers
        }
        self.fleet = Fleet(CONFIG, connections, tuple(connections))

    def probe(self, connection: Connection, config: Config) -> Facts:
        answer = self.answers[connection.board]
        if isinstance(answer, Unreachable):
            raise answer
        return answer

    def switch(self, connection: Connection, release: str) -> Switched:
        self.switched.append((connection.board, release))
        return Switched(Outcome.RUNS, release)


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as made:
        yield made


def robot(
    stack: ExitStack,
    monkeypatch: pytest.MonkeyPatch,
    raspberry: Facts | Unreachable,
    beaglebone: Facts | Unreachable,
) -> Boards:
    boards = Boards(stack, raspberry, beaglebone)
    monkeypatch.setattr(fleet, "probe", boards.probe)
    monkeypatch.setattr(fleet, "switch", boards.switch)
    return boards


def test_all_boards_go_back_to_the_release_before_the_board_of_comm_last(
    stack: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    boards = robot(stack, monkeypatch, facts("r2", "r2", "r1"), facts("r2", "r2", "r1", "r0"))
    assert fleet.go_back(boards.fleet)
    assert boards.switched == [("raspberry", "r1"), ("beaglebone", "r1")]


def test_after_an_update_that_ended_between_the_boards_only_the_switched_one_goes_back(
    stack: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    boards = robot(stack, monkeypatch, facts("r2", "r2", "r1"), facts("r1", "r1", "r0"))
    assert fleet.go_back(boards.fleet)
    assert boards.switched == [("raspberry", "r1")]
    assert boards.lines[-1] == "beaglebone: runs r1 already"


@pytest.mark.parametrize(
    ("raspberry", "beaglebone", "complaint"),
    [
        (facts("r2", "r2", "r1"), facts("r2", "r2"), "no earlier release that ran well on raspberry and beaglebone"),
        (facts("", ""), facts("", ""), "no earlier release that ran well"),
        (Unreachable("raspberry is away."), facts("r2", "r2", "r1"), "raspberry is away"),
        (facts("r2", "r2", "r1"), Unreachable("beaglebone is away."), "beaglebone is away"),
    ],
)
def test_where_not_all_can_go_back_none_does(
    stack: ExitStack,
    monkeypatch: pytest.MonkeyPatch,
    raspberry: Facts | Unreachable,
    beaglebone: Facts | Unreachable,
    complaint: str,
) -> None:
    boards = robot(stack, monkeypatch, raspberry, beaglebone)
    with pytest.raises(Refused, match=complaint):
        fleet.go_back(boards.fleet)
    assert boards.switched == []


def test_a_release_that_was_never_seen_to_run_well_is_switched_to_again(
    stack: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After a power cut between switch and health check the board has started it by itself."""
    boards = robot(stack, monkeypatch, facts("r2", "r2", "r1"), facts("r2", "r1"))
    answers = boards.fleet.answers()
    known = {board: answer for board, answer in answers.items() if isinstance(answer, Facts)}
    assert fleet._switch_all(boards.fleet, dict.fromkeys(boards.fleet.chosen, "r2"), known)
    assert boards.switched == [("beaglebone", "r2")]


def test_a_robot_that_drives_off_in_the_middle_of_an_update_gets_back_the_board_that_has_switched(
    stack: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It stood because a module was missing, which the new release has mended."""
    boards = robot(stack, monkeypatch, facts("r2", "r2", "r1"), facts("r2", "r2", "r1"))

    def mended(connection: Connection, release: str) -> Switched:
        boards.answers["beaglebone"] = facts("r2", "r2", "r1", permit=GRANTED)
        return boards.switch(connection, release)

    monkeypatch.setattr(fleet, "switch", mended)
    with pytest.raises(Refused, match="The robot may move"):
        fleet.go_back(boards.fleet)
    assert boards.switched == [("raspberry", "r1"), ("raspberry", "r2")]


def test_a_name_of_a_release_that_is_none_is_not_taken_from_a_board() -> None:
    assert facts("r2", "r2", '";reboot;"', "$(id)", "r1").good == ("r2", "r1")
