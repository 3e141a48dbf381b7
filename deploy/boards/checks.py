"""What stands in the way of a deployment, one sentence for each: on this machine, on a board, between boards. Pure."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

from common.access import role_of
from common.config import BoardSection, Config
from common.errors import StartError
from common.keys import checked_folder
from deploy.boards.layout import PYTHON, boards_in_use, modules_on
from deploy.boards.platforms import python_of
from deploy.boards.probe import Facts, needed_files

CLOCK_OFF_S = 0.5  # further apart than this, logs of the boards cannot be laid side by side
MEGABYTE = 1_000_000
_TOOLS = {"ssh": "openssh-client", "rsync": "rsync"}


def roles_on(config: Config, board: str) -> list[str]:
    """Whose keys a board holds; none where the mesh has no keys."""
    return list(dict.fromkeys(map(role_of, modules_on(config, board)))) if config.mesh.keys else []


def comm_board(config: Config) -> str:
    """The board with the router and the permit."""
    return config.board_of("comm")


def local_problems(config: Config, find: Callable[[str], str | None] = shutil.which) -> list[str]:
    """What is wrong before any board is looked at."""
    problems = [f"{tool} is missing: apt install {package}." for tool, package in _TOOLS.items() if not find(tool)]
    boards = boards_in_use(config)
    if not boards:
        problems.append('No board has an address: set ssh = "USER@HOST" in [beaglebone] or [raspberry] of robot.toml.')
    apart = [name for name, board in config.boards.items() if board.processes and name != comm_board(config)]
    if boards and apart and not (config.mesh.listen and config.mesh.robot):
        problems.append(
            f"comm runs on {comm_board(config)}, and {' and '.join(apart)} must reach it: set [mesh] listen and robot."
        )
    return problems + (_key_problems(config, boards) if config.mesh.keys else [])


def _key_problems(config: Config, boards: tuple[str, ...]) -> list[str]:
    problems = []
    for role in dict.fromkeys(role for board in (*boards, "laptop") for role in roles_on(config, board)):
        try:
            checked_folder(Path(config.mesh.keys), role)
        except StartError as error:
            problems.append(str(error))
    return problems


def board_problems(config: Config, board: str, facts: Facts) -> list[str]:
    """What is wrong with a board that answers."""
    section = config.boards[board]
    problems = [*_system_problems(board, section, facts)]
    if facts.missing_packages:
        problems.append(f"{board} lacks {', '.join(facts.missing_packages)}: run `deploy bootstrap`.")
    if not facts.has_user:
        problems.append(f"{board} has no user for the services: run `deploy bootstrap`.")
    problems += [f"{board} has no {file}." for file in needed_files(config, board) if file not in facts.files]
    if abs(facts.clock_offset_s) > CLOCK_OFF_S:
        problems.append(f"The clock of {board} is {facts.clock_offset_s:+.1f} s off: run `deploy clock --set`.")
    return problems


def fatal_problems(config: Config, board: str, facts: Facts) -> list[str]:
    """Those for which nothing may be sent: the release could not run there."""
    section = config.boards[board]
    problems = _system_problems(board, section, facts)
    if facts.missing_packages or not facts.has_user:
        problems.append(f"{board} is not prepared: run `deploy bootstrap`.")
    return problems


def _system_problems(board: str, section: BoardSection, facts: Facts) -> list[str]:
    problems = []
    if facts.platform != section.platform:
        problems.append(f"{board} is {facts.platform}; [{board}] platform of robot.toml is {section.platform}.")
    if facts.debian != str(section.debian):
        shown = f"Debian {facts.debian}" if facts.debian else "no Debian"
        problems.append(f"{board} has {shown}; [{board}] debian of robot.toml is {section.debian}.")
    if facts.python != python_of(section):
        shown = facts.python or "not there"
        problems.append(f"{PYTHON} of {board} is {shown}; Debian {section.debian} has {python_of(section)}.")
    if not facts.has_systemd:
        problems.append(f"{board} does not run systemd.")
    return problems


def release_problems(facts: Mapping[str, Facts]) -> list[str]:
    """Of the boards' releases: an update that did not come to its end, on one board or between them.

    Modules of different message tables do not drive together.
    """
    releases = {board: known.release for board, known in facts.items() if known.release}
    problems = [
        f"{board} was switched to {release} and not seen to run well since: run `deploy push` or `deploy rollback`."
        for board, release in releases.items()
        if release not in facts[board].good
    ]
    if len(set(releases.values())) > 1:
        told = ", ".join(f"{board} runs {release}" for board, release in releases.items())
        problems.append(f"The boards have different releases: {told}; run `deploy push` or `deploy rollback`.")
    return problems


def motion_problems(facts: Facts | None, board: str) -> list[str]:
    """Nothing may change while the robot may move; `facts`: of the board of comm, None where it does not answer."""
    if facts is None:
        return [f"{board} does not answer, so it is unknown whether the robot may move."]
    if facts.may_move:
        return ["The robot may move: stop it first with `estop`; afterwards it waits for `release` and `resume`."]
    return []
