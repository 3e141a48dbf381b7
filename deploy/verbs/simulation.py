"""Verbs `local`, `simulate` and `floors`: whole runs in the simulated building."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from deploy.local.mesh import run_local
from offboard.simulator.error_profiles import PROFILES
from offboard.simulator.run.options import CAMERAS, DEFAULT_FLOOR, RunOptions, floor_path, load_world, own_floors
from offboard.simulator.run.route import ROUTES


def add_verbs(verbs: Any) -> None:
    local = verbs.add_parser("local", help="the whole mesh as real processes on this machine")
    _add_run_arguments(local)
    local.add_argument("--speed", type=float, default=1.0, help="simulated over real time, at most (1)")
    local.add_argument("--headless", action="store_true", help="start by itself, end when the mission is finished")
    local.add_argument("--apart", action="store_true", help="every module in a process of its own, also on the robot")
    local.add_argument("--ros", action="store_true", help="publish into a graph of ROS 2 too; needs the extra ros")
    local.set_defaults(run=_local)
    simulate = verbs.add_parser("simulate", help="the same nodes in lockstep, as fast as the processor allows")
    _add_run_arguments(simulate)
    simulate.add_argument("--board", choices=("host", "avr"), default="host", help="which build of the firmware")
    simulate.add_argument("--route", choices=ROUTES, help="a scripted drive, for benchmarks of mapping and of doors")
    simulate.add_argument(
        "--reading-s", type=float, help="seconds that reading one photo takes, for a slower board (0.5, all at once)"
    )
    simulate.set_defaults(run=_simulate)
    floors = verbs.add_parser("floors", help="names of the floors that come with the project")
    floors.set_defaults(run=_floors)


def _add_run_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--floor", default=DEFAULT_FLOOR, help=f"floor file, or name of an own floor ({DEFAULT_FLOOR})")
    parser.add_argument("--start", type=int, default=0, help="which of the floor's starts, from 0")
    parser.add_argument("--seed", type=int, default=0, help="of every random number")
    parser.add_argument("--out", type=Path, help="run folder")
    parser.add_argument("--errors", choices=tuple(PROFILES), default="realistic", help="how badly the robot errs")
    parser.add_argument("--camera", choices=CAMERAS, default="off", help="the simulated camera")
    parser.add_argument("--config", type=Path, help="robot.toml, of which [poi] holds: what plates look like")
    parser.add_argument("--events", type=Path, help="file of people, barriers and doors that come and go")


def _options(arguments: argparse.Namespace) -> RunOptions:
    return RunOptions(
        floor=floor_path(arguments.floor),
        start=arguments.start,
        seed=arguments.seed,
        speed=getattr(arguments, "speed", 1.0),
        headless=getattr(arguments, "headless", True),
        apart=getattr(arguments, "apart", False),
        ros=getattr(arguments, "ros", False),
        out=arguments.out,
        errors=arguments.errors,
        camera=arguments.camera,
        events=arguments.events,
        config=arguments.config,
        board=getattr(arguments, "board", "host"),
        route=getattr(arguments, "route", None),
        reading_s=getattr(arguments, "reading_s", None),
    )


def _local(arguments: argparse.Namespace) -> int:
    return run_local(_options(arguments))


def _simulate(arguments: argparse.Namespace) -> int:
    from offboard.simulator.run.lockstep import simulate  # here, because it loads all modules of the robot and MuJoCo

    options = _options(arguments)
    load_world(options)
    code: int = simulate(options)
    return code


def _floors(_: argparse.Namespace) -> int:
    print("\n".join(own_floors()))
    return 0
