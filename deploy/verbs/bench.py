"""Verb `bench`: figures of this machine. They are printed only; the tests assert what must hold."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from common.errors import StartError
from deploy.bench.machine import machine
from deploy.bench.order import PAIRS, PAIRS_QUICK, Order

# Name -> what it measures, and the function that does: bench(quick) prints its figures
BENCHES = {
    "bus": ("our bus against bare Zenoh: latency, processor", "deploy.bench.bus_overhead"),
    "stop": ("software stop, command to wheels off, on an idle and on a full link", "deploy.bench.stop_latency"),
    "page": (
        "the page: pose to pixel, its server's processor, click on stop to wheels off",
        "deploy.bench.page_latency",
    ),
    "board": ("what the programs of the BeagleBone cost, and the share of its processor", "deploy.bench.board_budget"),
    "slow-core": ("a mission whose programs of the BeagleBone share one slowed core", "deploy.bench.one_core"),
    "mapping": ("what the mapping unit costs: processor, memory, instructions of a step", "deploy.bench.mapping_cost"),
    "signs": ("how well rendered signs are read, and what a full frame costs", "deploy.bench.sign_reading"),
    "doors": ("how many doors of hard looks are found along drawn walls", "deploy.bench.door_finding"),
    "exploration": ("missions without camera: way, halls, walls, time, home", "deploy.bench.exploration"),
    "firmware": ("what the firmware costs on the Mega, in simavr", "deploy.bench.firmware_cost"),
}


def add_verbs(verbs: Any) -> None:
    names = "; ".join(f"{name}: {what}" for name, (what, _) in BENCHES.items())
    bench = verbs.add_parser("bench", help="measure this machine", epilog=names)
    bench.add_argument("name", nargs="*", metavar="NAME", help=f"{', '.join(BENCHES)} (all)")
    bench.add_argument("--quick", action="store_true", help="fewer repetitions")
    bench.add_argument(
        "--against", type=Path, metavar="FOLDER", help="board, signs: measure another checkout of it too, by turns"
    )
    bench.add_argument("--pairs", type=int, help=f"turns with --against ({PAIRS}, with --quick {PAIRS_QUICK})")
    bench.add_argument("--floors", type=Path, metavar="FOLDER", help="exploration: its floor files, not our own")
    bench.set_defaults(run=_bench)


def _bench(arguments: argparse.Namespace) -> int:
    names = arguments.name or list(BENCHES)
    for name in names:
        if name not in BENCHES:
            raise StartError(f"There is no benchmark {name}; the benchmarks are {', '.join(BENCHES)}.")
    if arguments.against is not None and not (arguments.against / "deploy" / "cli.py").is_file():
        raise StartError(f"{arguments.against} is no checkout of this project.")
    if arguments.floors is not None and not any(arguments.floors.glob("*.json")):
        raise StartError(f"{arguments.floors} holds no floor file.")
    pairs = arguments.pairs or (PAIRS_QUICK if arguments.quick else PAIRS)
    order = Order(arguments.quick, arguments.against, pairs, arguments.floors)
    print(machine(), flush=True)
    for name in names:
        what, module = BENCHES[name]
        print(f"\n{name}: {what}", flush=True)
        # Here, because each loads half of the project
        bench: Callable[[Order], None] = importlib.import_module(module).bench
        bench(order)
    return 0
