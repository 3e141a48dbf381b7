"""Verb `estop`: what it needs to send the stop is loaded first; all else while the stop is on its way."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any


def add_verbs(verbs: Any) -> None:
    text = "latch the software stop; the red button on the robot is the emergency stop"
    parser = verbs.add_parser("estop", help=text)
    parser.add_argument("--config", type=Path, help="robot.toml of the mesh")
    parser.set_defaults(run=_estop)


def _estop(arguments: argparse.Namespace) -> int:
    from common.config_file import load_config
    from offboard.operate.stop_at_once import StopAtOnce

    with StopAtOnce(load_config(arguments.config)) as press:
        from common.messages.topics import PERMIT
        from deploy.verbs.operator import join
        from offboard.operate.operator_client import hold_stop

        bus = join(arguments.config)
        try:
            control = hold_stop(bus, press.since_s, press.stop_id)
            if control.latency_s is not None:
                latency_ms = 1000 * control.latency_s
                print(f"Stopped: the stop is latched and the wheels stand still, confirmed in {latency_ms:.0f} ms.")
                return 0
            permit = bus.latest(PERMIT)
            latched = permit is not None and press.stop_id in permit.stop_ids
            known = (
                "The stop is latched, but no report shows that the wheels stand still" if latched else "Not confirmed"
            )
            print(f"{known}: use the red button on the robot.", file=sys.stderr)
            return 1
        finally:
            bus.close()
