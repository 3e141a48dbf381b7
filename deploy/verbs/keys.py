"""`deploy keys`: certificates of all machines, and the key that commands are signed with."""

from __future__ import annotations

import argparse
import importlib.util
import sys
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from common.access import ROLES
from common.config import Config
from common.config_file import load_config
from common.errors import StartError


def add_keys_verb(tasks: Any, config_file: Path) -> None:
    keys = tasks.add_parser("keys", help="certificates for all machines, and the key that commands are signed with")
    keys.add_argument("--to", type=Path, metavar="DIR", help="folder for a folder per role; by default [mesh] keys")
    keys.add_argument(
        "--machine",
        nargs="+",
        action="extend",
        default=[],
        metavar="NAME=HOST_OR_IP",
        help=f"where a machine is found, NAME being one of {', '.join(ROLES)}; by default the robot, as [mesh] robot",
    )
    keys.add_argument("--config", type=Path, default=config_file, help="robot.toml, for both defaults (robot.toml)")
    keys.add_argument("--replace", action="store_true", help="make new keys where there are some already")
    keys.add_argument("--dry-run", action="store_true", help="show what would be done, and do nothing")
    keys.set_defaults(run=_keys)


def _keys(arguments: argparse.Namespace) -> int:
    needs_config = arguments.to is None or not arguments.machine
    config = load_config(arguments.config) if needs_config else Config()
    hosts = hosts_of(arguments.machine) if arguments.machine else hosts_of_config(config)
    if arguments.to is None and not config.mesh.keys:
        raise StartError("Name the folder with --to, or as [mesh] keys in robot.toml.")
    folder = arguments.to or Path(config.mesh.keys)
    if arguments.dry_run:
        sys.stdout.write(
            f"Would make keys in {folder} for {', '.join(host for names in hosts.values() for host in names)}.\n"
        )
        return 0
    _make(folder, hosts, replace=arguments.replace)
    return 0


def make_missing_keys(config: Config, *, dry_run: bool) -> None:
    """Those of robot.toml, where none are yet; raises StartError."""
    folder = Path(config.mesh.keys).expanduser()
    if not config.mesh.keys or folder.exists():
        return
    if dry_run:
        raise StartError(f"There are no keys in {folder} yet: `deploy keys` would make them first.")
    _make(folder, hosts_of_config(config), replace=False)


def _make(folder: Path, hosts: Mapping[str, list[str]], *, replace: bool) -> None:
    if importlib.util.find_spec("cryptography") is None:
        raise StartError("Making keys needs the package cryptography: run ./deploy/local.sh --setup-only once.")
    # Only where keys are made is there that package
    from deploy.boards.certificates import VALID_FOR, make_keys

    until = datetime.now(UTC) + VALID_FOR
    try:
        make_keys(folder, hosts, replace=replace, until=until)
    except OSError as error:
        raise StartError(f"The keys cannot be written to {folder}: {error.strerror}.") from error
    sys.stdout.write(
        f"Keys valid until {until:%Y-%m-%d} are in {folder}, a folder per role: {', '.join(ROLES)}.\n"
        f"`deploy bootstrap` gives each board its own; [mesh] keys in robot.toml names the folder above them.\n"
    )


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


def hosts_of_config(config: Config) -> dict[str, list[str]]:
    """The robot, as `[mesh] robot` names it; raises StartError."""
    host = config.mesh.robot.removeprefix("tls/").rpartition(":")[0]
    if not host:
        raise StartError('Set [mesh] robot = "tls/HOST:PORT" in robot.toml, or give --machine robot=HOST_OR_IP.')
    return {"robot": [host.strip("[]")]}
