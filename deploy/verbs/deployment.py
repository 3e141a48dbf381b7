"""Verb `deploy`, for a mesh on several machines: `deploy keys` makes the files by which they know each other."""

from __future__ import annotations

import argparse
import importlib.util
import sys
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from common.access import ROLES
from common.errors import StartError


def add_verbs(verbs: Any) -> None:
    deploy = verbs.add_parser("deploy", help="get the mesh onto the boards: keys")
    tasks = deploy.add_subparsers(dest="task", metavar="TASK", required=True)
    keys = tasks.add_parser("keys", help="certificates for all machines, and the key that commands are signed with")
    keys.add_argument("--to", type=Path, required=True, metavar="DIR", help="folder for a folder per role")
    keys.add_argument(
        "--machine",
        nargs="+",
        action="extend",
        default=[],
        metavar="NAME=HOST_OR_IP",
        help=f"where a machine is found, NAME being one of {', '.join(ROLES)}; the robot's is needed, several may be",
    )
    keys.add_argument("--replace", action="store_true", help="make new keys where there are some already")
    keys.set_defaults(run=_keys)


def _keys(arguments: argparse.Namespace) -> int:
    hosts = hosts_of(arguments.machine)
    if importlib.util.find_spec("cryptography") is None:
        raise StartError("Making keys needs the package cryptography: run ./deploy/local.sh --setup-only once.")
    # Only where keys are made is there that package
    from deploy.boards.certificates import VALID_FOR, make_keys

    folder: Path = arguments.to
    until = datetime.now(UTC) + VALID_FOR
    try:
        make_keys(folder, hosts, replace=arguments.replace, until=until)
    except OSError as error:
        raise StartError(f"The keys cannot be written to {folder}: {error.strerror}.") from error
    sys.stdout.write(
        f"Keys valid until {until:%Y-%m-%d} are in {folder}, a folder per role: {', '.join(ROLES)}.\n"
        f"Give each machine its own folder only; [mesh] keys in its robot.toml names the folder above it.\n"
    )
    return 0


def hosts_of(machines: Iterable[str]) -> dict[str, list[str]]:
    """NAME=HOST_OR_IP, several for one NAME too -> hosts by role; raises StartError."""
    hosts: dict[str, list[str]] = {}
    for machine in machines:
        role, equals, host = machine.partition("=")
        if role not in ROLES or not equals or not host:
            raise StartError(f"--machine wants NAME=HOST_OR_IP with a NAME of {', '.join(ROLES)}, not {machine!r}.")
        hosts.setdefault(role, []).append(host)
    if "robot" not in hosts:
        raise StartError("--machine robot=HOST_OR_IP is needed: its certificate names the address of the robot.")
    return hosts
