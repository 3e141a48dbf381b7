"""All boards of a robot at once: connections to them, what each does, and a release onto all of them or none.

The board of comm comes last: until then its router and its stop run as they were, and where another board has a release
of another message table already, comm keeps the wheels off (`onboard/comm/watchdog.py`). What a failed update has
switched is switched back.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from common.config import Config
from common.errors import StartError
from deploy.boards import layout
from deploy.boards.checks import MEGABYTE, comm_board, fatal_problems, motion_problems
from deploy.boards.probe import Facts, probe
from deploy.boards.release import LAST_GOOD, Outcome, deliver, is_there, needed_bytes, switch
from deploy.boards.ssh import BoardError, Connection, Output
from deploy.boards.tree import Tree


class Refused(StartError):
    """Nothing was changed, for the reasons in `problems`, a sentence each."""

    def __init__(self, problems: Iterable[str]) -> None:
        self.problems = tuple(problems)
        super().__init__(" ".join(self.problems))


@dataclass(frozen=True, slots=True)
class Fleet:
    """Connections by board, the board of comm last; `chosen`: those that a person means."""

    config: Config
    connections: Mapping[str, Connection]
    chosen: tuple[str, ...]

    def each(self) -> Iterator[Connection]:
        """Those that are meant."""
        return (self.connections[board] for board in self.chosen)

    def answers(self) -> dict[str, Facts | BoardError]:
        """Of every chosen board: what it is, or why it does not answer."""
        return {connection.board: self._answer(connection) for connection in self.each()}

    def _answer(self, connection: Connection) -> Facts | BoardError:
        try:
            return probe(connection, self.config)
        except BoardError as error:
            return error

    def refuse_while_moving(self) -> None:
        """Raises Refused while the robot may move, or when nobody can know."""
        connection = self.connections.get(comm_board(self.config))
        if connection is None:
            return
        answer = self._answer(connection)
        problems = motion_problems(answer if isinstance(answer, Facts) else None, connection.board)
        if problems:
            raise Refused(problems)


@contextmanager
def open_fleet(config: Config, boards: Sequence[str], report: Output, *, dry_run: bool = False) -> Iterator[Fleet]:
    """`boards`: the names that are meant; all that are in use where there are none. Raises StartError."""
    in_use = layout.boards_in_use(config)
    strange = [board for board in boards if board not in in_use]
    if strange or not in_use:
        known = ", ".join(in_use) or "none"
        raise StartError(
            f"{' and '.join(strange) or 'No board'} has an address in robot.toml; boards there are: {known}."
        )
    last = comm_board(config)
    ordered = sorted(in_use, key=lambda board: board == last)
    with ExitStack() as stack:
        connections = {
            board: stack.enter_context(Connection(board, config.boards[board].ssh, report, dry_run=dry_run))
            for board in ordered
        }
        yield Fleet(config, connections, tuple(board for board in ordered if not boards or board in boards))


def check_all(fleet: Fleet, trees: Mapping[str, Tree]) -> dict[str, Facts]:
    """What the boards are; raises Refused when one is away or could not run its tree."""
    facts: dict[str, Facts] = {}
    problems: list[str] = []
    for board, answer in fleet.answers().items():
        if isinstance(answer, BoardError):
            problems.append(str(answer))
            continue
        facts[board] = answer
        found = fatal_problems(fleet.config, board, answer)
        if not found:
            needed, free = needed_bytes(fleet.connections[board], trees[board]), 1024 * answer.free_kb
            if needed > free:
                room = f"{free / MEGABYTE:.0f} MB free, and the release needs {needed / MEGABYTE:.0f} MB"
                found.append(f"{board} has {room}: remove something there.")
        problems += found
    if problems:
        raise Refused(problems)
    return facts


def push(fleet: Fleet, trees: Mapping[str, Tree]) -> bool:
    """Sends the trees, then switches board by board; False when one did not run its own. Raises StartError."""
    facts = check_all(fleet, trees)
    fleet.refuse_while_moving()
    for connection in fleet.each():
        tree = trees[connection.board]
        if is_there(connection, tree.release):
            connection.report(f"has {tree.release} already")
            continue
        connection.report(f"sending {tree.release} ...")
        link_bytes = deliver(connection, tree)
        connection.report(f"{link_bytes / MEGABYTE:.2f} MB went over the link")
    return _switch_all(fleet, {board: trees[board].release for board in fleet.chosen}, facts)


def go_back(fleet: Fleet) -> bool:
    """All to the newest release that ran well on each of them and that not all run now; False when it does not run.

    After an update that ended between two boards this is the release of the board that has not switched.
    """
    facts = _sound_answers(fleet)
    fleet.refuse_while_moving()
    *others, last = facts.values()
    shared = [release for release in last.good if all(release in other.good for other in others)]
    release = next((r for r in shared if any(known.release != r for known in facts.values())), None)
    if release is None:
        raise Refused([f"There is no earlier release that ran well on {' and '.join(facts)}."])
    return _switch_all(fleet, dict.fromkeys(fleet.chosen, release), facts)


def _sound_answers(fleet: Fleet) -> dict[str, Facts]:
    """Of all chosen boards; raises Refused when one is away."""
    answers = fleet.answers()
    problems = [str(answer) for answer in answers.values() if isinstance(answer, BoardError)]
    if problems:
        raise Refused(problems)
    return {board: answer for board, answer in answers.items() if isinstance(answer, Facts)}


def _switch_all(fleet: Fleet, releases: Mapping[str, str], facts: Mapping[str, Facts]) -> bool:
    """Board by board; where one does not run its release, those before it go back to theirs."""
    switched: list[Connection] = []
    for connection in fleet.each():
        known = facts.get(connection.board)
        if known is not None and known.runs(releases[connection.board]) and known.release in known.good:
            connection.report(f"runs {known.release} already")
            continue
        try:
            fleet.refuse_while_moving()  # a robot that lacked a module may have got it back just now
            connection.report("switching ...")
            result = switch(connection, releases[connection.board])
        except (BoardError, Refused):
            _switch_back(switched, facts)
            raise
        if result.outcome is not Outcome.RUNS:
            connection.report(f"{result.text}.")
            _switch_back(switched, facts)
            return False
        connection.report(f"runs {result.text}")
        switched.append(connection)
    return True


def _switch_back(switched: Iterable[Connection], facts: Mapping[str, Facts]) -> None:
    for connection in switched:
        known = facts.get(connection.board)
        try:
            result = switch(connection, known.release if known is not None and known.release else LAST_GOOD)
        except BoardError as error:
            connection.report(str(error))
            continue
        connection.report(f"runs {result.text} again" if result.outcome is Outcome.RUNS else result.text)
