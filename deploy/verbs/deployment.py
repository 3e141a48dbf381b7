"""Verb `deploy`: the robot's programs onto its boards, over ssh, and what they do there."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from common.config import Config
from common.config_file import load_config
from common.errors import StartError
from deploy.boards import checks, fleet, services
from deploy.boards.fleet import Fleet, Refused, open_fleet
from deploy.boards.probe import Facts, clock_offset_s, probe
from deploy.boards.tree import Tree, assemble
from deploy.verbs.flash import add_flash_verb
from deploy.verbs.keys import add_keys_verb, make_missing_keys

CONFIG = Path("robot.toml")
Task = Callable[[Fleet, argparse.Namespace], int]


def add_verbs(verbs: Any) -> None:
    deploy = verbs.add_parser(
        "deploy", help="get the programs onto the boards of robot.toml, and look after them there"
    )
    tasks = deploy.add_subparsers(dest="task", metavar="TASK", required=True)
    add_keys_verb(tasks, CONFIG)
    add_flash_verb(tasks, CONFIG)
    _add(tasks, "check", _check, "everything that stands in the way of a push; changes nothing")
    bootstrap = _add(tasks, "bootstrap", _bootstrap, "prepare bare boards: clock, packages, user, folders, keys")
    bootstrap.add_argument(
        "--debs", type=Path, metavar="DIR", help="folder of .deb files, for boards without a network"
    )
    _add(tasks, "push", _push, "send the programs and switch to them, or back when they do not run")
    _add(tasks, "rollback", _rollback, "switch to the last release that ran well before this one")
    _add(tasks, "status", _status, "release, load, temperature, disk and clock of every board, and its services")
    logs = _add(tasks, "logs", _logs, "the newest log lines of all boards")
    logs.add_argument("-f", "--follow", action="store_true", help="go on with what comes")
    logs.add_argument("-n", "--lines", type=int, default=services.LINES, help=f"of each board ({services.LINES})")
    _add(tasks, "start", _start, "start the services")
    _add(tasks, "stop", _stop, "stop the services; the robot stands")
    clock = _add(tasks, "clock", _clock, "how far the boards' clocks are from this machine's")
    clock.add_argument("--set", action="store_true", help="set them")


def _add(tasks: Any, name: str, task: Task, text: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = tasks.add_parser(name, help=text)
    parser.add_argument("--config", type=Path, default=CONFIG, help="robot.toml, which has the boards (robot.toml)")
    parser.add_argument("--board", action="append", default=[], metavar="NAME", help="only this one; may be repeated")
    parser.add_argument("--dry-run", action="store_true", help="show what would be done, and do nothing")
    parser.set_defaults(run=lambda arguments: _run(task, arguments))
    return parser


def _run(task: Task, arguments: argparse.Namespace) -> int:
    config = load_config(arguments.config)
    problems = checks.local_problems(config)
    if arguments.task == "bootstrap":
        make_missing_keys(config, dry_run=arguments.dry_run)
        problems = checks.local_problems(config)
    if problems:
        return _complain(problems)
    try:
        with open_fleet(config, arguments.board, _print, dry_run=arguments.dry_run) as boards:
            return task(boards, arguments)
    except Refused as refused:
        return _complain(refused.problems)
    except KeyboardInterrupt:
        return 130


def _print(line: str) -> None:
    print(line, flush=True)


def _complain(problems: list[str] | tuple[str, ...]) -> int:
    for problem in problems:
        print(problem, file=sys.stderr)
    return 2


def _facts(boards: Fleet) -> tuple[dict[str, Facts], list[str]]:
    """Of the boards that answer, and why the others do not."""
    answers = boards.answers()
    facts = {board: answer for board, answer in answers.items() if isinstance(answer, Facts)}
    return facts, [str(answer) for answer in answers.values() if not isinstance(answer, Facts)]


def _trees(config: Config, boards: Fleet) -> Mapping[str, Tree]:
    from platformdirs import user_cache_path

    return assemble(config, boards.chosen, user_cache_path("indoor-mapping"), _print)


def _check(boards: Fleet, arguments: argparse.Namespace) -> int:
    facts, problems = _facts(boards)
    for board, known in facts.items():
        problems += checks.board_problems(boards.config, board, known)
    problems += checks.release_problems(facts)
    if problems:
        return _complain(problems)
    _print(f"Nothing stands in the way on {' and '.join(boards.chosen)}.")
    return 0


def _bootstrap(boards: Fleet, arguments: argparse.Namespace) -> int:
    from deploy.boards.bootstrap import bootstrap

    boards.refuse_while_moving()
    for connection in boards.each():
        connection.report("preparing ...")
        bootstrap(connection, boards.config, probe(connection, boards.config), arguments.debs)
        connection.report("prepared")
    return 0


def _push(boards: Fleet, arguments: argparse.Namespace) -> int:
    return 0 if fleet.push(boards, _trees(boards.config, boards)) else 1


def _rollback(boards: Fleet, arguments: argparse.Namespace) -> int:
    return 0 if fleet.go_back(boards) else 1


def _status(boards: Fleet, arguments: argparse.Namespace) -> int:
    facts, problems = _facts(boards)
    for board, known in facts.items():
        for line in services.status_lines(known):
            _print(line if line.startswith(" ") else f"{board}: {line}")
    problems += checks.release_problems(facts)
    for problem in problems:
        print(problem, file=sys.stderr)
    return 1 if problems else 0


def _logs(boards: Fleet, arguments: argparse.Namespace) -> int:
    if arguments.lines < 0:
        raise StartError("--lines must not be negative.")
    return services.show_logs(boards.each(), arguments.lines, follow=arguments.follow, show=_print)


def _start(boards: Fleet, arguments: argparse.Namespace) -> int:
    for connection in boards.each():
        services.start(connection)
        connection.report("started")
    return 0


def _stop(boards: Fleet, arguments: argparse.Namespace) -> int:
    for connection in boards.each():
        services.stop(connection)
        connection.report("stopped")
    return 0


def _clock(boards: Fleet, arguments: argparse.Namespace) -> int:
    from deploy.boards.bootstrap import set_clock

    for connection in boards.each():
        connection.report(f"clock {clock_offset_s(connection):+.2f} s")
        if arguments.set:
            set_clock(connection)
    return 0
