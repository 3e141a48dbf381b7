"""Where things are on a board. One folder per release; `CURRENT` leads to the one that runs.

releases/NAME/   app/  the packages of this project     site/   what pip has for the board's platform
                 units/  for systemd                    robot.toml, release.json
                 .ok    it ran well once: what a broken release returns to
"""

from __future__ import annotations

from common.config import BoardSection, Config

USER = "indoor-mapping"  # and its group
HOME = "/opt/indoor-mapping"
RELEASES = f"{HOME}/releases"
CURRENT = f"{HOME}/current"
CONFIG = f"{CURRENT}/robot.toml"
KEYS = "/etc/indoor-mapping/keys"
STATE = "/var/lib/indoor-mapping"  # logs, and what must outlive a restart: stop record, outbox, map
RUNTIME = "/run/indoor-mapping"
UNITS = "/etc/systemd/system"
UNIT_PREFIX = "indoor-mapping"
TARGET = f"{UNIT_PREFIX}.target"
PYTHON = "/usr/bin/python3"
PYTHONPATH = f"{CURRENT}/app:{CURRENT}/site"


def unit_name(process: str) -> str:
    """The unit of a process as `robot.toml` names it; it may hold no +."""
    return f"{UNIT_PREFIX}-{process.replace('+', '-')}.service"


def is_used(board: BoardSection) -> bool:
    """Does `deploy` care for it: has it an address, and runs it something?"""
    return bool(board.ssh and board.processes)


def boards_in_use(config: Config) -> tuple[str, ...]:
    """The names of the boards that `deploy` cares for."""
    return tuple(name for name, board in config.boards.items() if is_used(board))


def modules_on(config: Config, board: str) -> tuple[str, ...]:
    """The modules that a board runs."""
    return tuple(module for process in config.boards[board].processes for module in process.split("+"))
