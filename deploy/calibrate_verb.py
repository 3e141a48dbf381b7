"""Verb `calibrate WHAT`: measure this very robot and write it into robot.toml. Each part brings its own WHAT."""

from __future__ import annotations

from typing import Any

from deploy import board_verbs, vision_verbs


def add_verbs(verbs: Any) -> None:
    calibrate = verbs.add_parser("calibrate", help="measure this very robot and write it into robot.toml")
    things = calibrate.add_subparsers(dest="what", metavar="WHAT", required=True)
    board_verbs.add_calibrations(things)
    vision_verbs.add_calibrations(things)
