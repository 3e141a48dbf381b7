"""`deploy flash`: the firmware onto the Mega, from this machine or from the board that its cable leads to."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from common.config import Config
from common.config_file import load_config
from common.errors import StartError
from deploy.boards.flash import flash_here, flash_on
from deploy.boards.fleet import open_fleet
from deploy.boards.layout import unit_name


def add_flash_verb(tasks: Any, config_file: Path) -> None:
    flash = tasks.add_parser("flash", help="the firmware onto the Mega, unless it has it already")
    flash.add_argument("--config", type=Path, default=config_file, help="robot.toml, which has the boards (robot.toml)")
    flash.add_argument("--port", help="of this machine, where the Mega hangs on it; by default as robot.toml has it")
    flash.add_argument("--firmware", type=Path, metavar="FILE", help="Intel HEX; by default built from arduino/")
    flash.add_argument("--dry-run", action="store_true", help="show what would be done, and do nothing")
    flash.set_defaults(run=_flash)


def _flash(arguments: argparse.Namespace) -> int:
    given = arguments.port is not None and not arguments.config.exists()
    config = Config() if given else load_config(arguments.config)
    firmware: Path = arguments.firmware or _built()
    if not firmware.is_file():
        raise StartError(f"There is no firmware {firmware}.")
    port: str = arguments.port or config.bridge.serial_port
    board = config.board_of("bridge")
    there = arguments.port is None and bool(config.boards[board].ssh)
    where = f"the Mega at {port} of {board if there else 'this machine'}"
    if arguments.dry_run:
        print(f"would flash {where} with {firmware}")
        return 0
    written = _flash_there(config, board, firmware) if there else flash_here(port, firmware, print)
    print(f"{where} {'is flashed' if written else 'has this firmware already'}")
    return 0


def _flash_there(config: Config, board: str, firmware: Path) -> bool:
    bridge = unit_name(config.process_of("bridge"))
    with open_fleet(config, [board], print) as boards:
        boards.refuse_while_moving()
        return flash_on(boards.connections[board], bridge, config.bridge.serial_port, firmware)


def _built() -> Path:
    """Made anew where a source has changed."""
    # Here, because it loads the simulator
    from offboard.simulator.electronics.avr_board import build_avr_firmware
    from offboard.simulator.electronics.board import FirmwareBuildError

    try:
        return build_avr_firmware().with_suffix(".hex")
    except FirmwareBuildError as error:
        raise StartError(f"{str(error).splitlines()[0]}.") from error
