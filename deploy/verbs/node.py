"""Verbs `node NAME` and `command-center`: one process, as boards and laptop run it. It replaces this process."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import Any

from common.config_file import load_config
from common.errors import StartError
from common.process import argument_parser
from deploy.local.process_table import PROCESSES, program_of


def add_verbs(verbs: Any) -> None:
    node = verbs.add_parser("node", help="one process of the mesh")
    node.add_argument("name", metavar="NAME", help=f"{', '.join(PROCESSES)}, or modules of the robot joined by +")
    # Whatever follows NAME belongs to the process, --help as well
    node.add_argument("arguments", nargs=argparse.REMAINDER, help="--config FILE, --log-dir DIR and the process's own")
    node.set_defaults(run=_node)
    center = verbs.add_parser("command-center", help="the terminal UI of a mesh that runs: status, log, stop, commands")
    center.add_argument("--config", type=Path, help="robot.toml of the mesh")
    center.add_argument("--log-dir", type=Path, help="folder for its own log and exported ones")
    center.add_argument("--run-dir", type=Path, help="run folder whose doors are known already; found by --config")
    center.set_defaults(run=_command_center)


def _command_center(arguments: argparse.Namespace) -> int:
    given = {"--config": arguments.config, "--log-dir": arguments.log_dir, "--run-dir": arguments.run_dir}
    # A mistake in the file is one sentence before the screen is taken
    load_config(arguments.config)
    words = [word for name, value in given.items() if value is not None for word in (name, str(value))]
    os.execv(sys.executable, [sys.executable, "-m", PROCESSES["command_center"], *words])


def _node(arguments: argparse.Namespace) -> int:
    try:
        program = program_of(arguments.name)
    except KeyError:
        raise StartError(f"There is no process {arguments.name}; choose one of {', '.join(PROCESSES)}.") from None
    if arguments.name == "bridge":
        _check_serial_port(arguments.arguments)
    os.execv(sys.executable, [sys.executable, "-m", *program, *arguments.arguments])


def _check_serial_port(arguments: list[str]) -> None:
    """A port that is not there at the start is a mistake; one that is lost later, the bridge waits for."""
    known, _ = argument_parser("bridge").parse_known_args(arguments)
    port = load_config(known.config).bridge.serial_port
    if not Path(port).exists():
        raise StartError(f"{port} is not there: plug in the Arduino, or set bridge.serial_port in robot.toml.")
