"""Verb `zone`: no-go lines and areas, and areas to stay in, drawn, removed and listed from the command line."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from common.errors import StartError
from common.messages.topics import ZONES
from common.zones import zones_of
from deploy.verbs.operator import LINK_TIMEOUT_S, give, join
from offboard.command_center.places import UnknownPlace
from offboard.command_center.zone_text import ALL, DRAWN, REMOVE, zone_order
from offboard.operate.operator_client import wait_until


def add_verbs(verbs: Any) -> None:
    parser = verbs.add_parser("zone", help="draw, remove or list no-go lines and areas")
    kinds = parser.add_subparsers(dest="kind", metavar="WHAT", required=True)
    for name, (_, text) in DRAWN.items():
        drawn = kinds.add_parser(name, help=text)
        drawn.add_argument("words", metavar="X,Y", nargs="+", help="its corners in order, metres on the map")
        drawn.set_defaults(run=_order)
    removed = kinds.add_parser(REMOVE, help="remove one, or all")
    removed.add_argument("words", metavar="NUMBER", nargs=1, help=f"as `zone list` shows it, or {ALL}")
    removed.set_defaults(run=_order)
    kinds.add_parser("list", help="list all that count now").set_defaults(run=_list)
    for kind in kinds.choices.values():
        kind.add_argument("--config", type=Path, help="robot.toml of the mesh")


def _order(arguments: argparse.Namespace) -> int:
    """Judged before it connects to the mesh."""
    try:
        order = zone_order([arguments.kind, *arguments.words])
    except UnknownPlace as error:
        raise StartError(str(error)) from error
    return give(arguments.config, order)


def _list(arguments: argparse.Namespace) -> int:
    bus = join(arguments.config)
    try:
        wait_until(lambda: bus.latest(ZONES) is not None, LINK_TIMEOUT_S)
        message = bus.latest(ZONES)
        if message is None:
            print("No message from the planner arrived.", file=sys.stderr)
            return 1
        for zone in zones_of(message):
            print(f"{zone.number:3}  {zone.kind.value:10}  {' '.join(f'{x:.2f},{y:.2f}' for x, y in zone.corners_m)}")
        return 0
    finally:
        bus.close()
