"""Verb `node NAME`: one process, as the boards run it. It takes the place of this one."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import Any

from common.config import load_config
from common.errors import StartError
from common.process import argument_parser
from deploy.process_table import BY_NAME


def add_verbs(verbs: Any) -> None:
    node = verbs.add_parser("node", help="one process of the mesh", add_help=False)
    node.add_argument("name", metavar="NAME", help=", ".join(BY_NAME))
    node.add_argument("arguments", nargs=argparse.REMAINDER, help="--config FILE, --log-dir DIR and the process's own")
    node.set_defaults(run=_node)


def _node(arguments: argparse.Namespace) -> int:
    spec = BY_NAME.get(arguments.name)
    if spec is None:
        raise StartError(f"There is no process {arguments.name}; choose one of {', '.join(BY_NAME)}.")
    if spec.name == "bridge":
        _check_serial_port(arguments.arguments)
    os.execv(sys.executable, [sys.executable, "-m", spec.module, *arguments.arguments])


def _check_serial_port(arguments: list[str]) -> None:
    """A port that is not there at the start is a mistake; one that is lost later, the bridge waits for."""
    known, _ = argument_parser("bridge").parse_known_args(arguments)
    port = load_config(known.config).bridge.serial_port
    if not Path(port).exists():
        raise StartError(f"{port} is not there: plug in the Arduino, or set bridge.serial_port in robot.toml.")
