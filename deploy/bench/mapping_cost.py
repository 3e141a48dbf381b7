"""What the mapping unit costs: processor time per step, memory of its two processes, instructions per step.

`bench()` drives the real node with its real worker process round `mapping_course` in a process of its own, on a real
Zenoh session, and prints. Time is the processor's for the node's thread, publishing included; memory is resident memory
(RSS, what `top` shows) of both processes, and PSS, where what they share counts half.
"""

from __future__ import annotations

import argparse
import math
import os
import re
import shutil
import subprocess
import sys
import time
from array import array
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from common.bus import Bus
from common.clock import FreeClock
from common.codec import decode, encode
from common.config import Config
from common.constants import SENSOR_RATE_HZ
from common.environment import PROCESS_ENVIRONMENT
from common.messages.motion import Odometry, Ranges
from common.messages.topics import ODOMETRY, RANGES, Topic
from common.side_process import ProcessWorker
from common.zenoh_bus import ZenohBus
from deploy.bench.mapping_course import Course
from deploy.bench.order import Order
from deploy.local.ports import reserve_port
from onboard.mmu.back_end.exchange import Correction, Increment
from onboard.mmu.mmu import BACK_END, MappingUnit

MARKS_M = (100.0, 300.0, 600.0, 1000.0)
QUICK_MARKS_M = (100.0,)
PACE = 40.0  # times real time: the search has as little time as on a board that much slower
COUNTED_REPORTS = (300, 900)  # the first of them are not counted
# Of a Cortex-A8 at 1 GHz: what one x86-64 instruction of an interpreter becomes, and how many it does in a cycle
A8_HZ, A8_INSTRUCTIONS, A8_PER_CYCLE = 1e9, 1.3, (0.3, 0.7)
P = TypeVar("P")


class InputBus:
    """What a node needs of a bus: bytes in, decoded as it takes them; out on `out`, or only encoded."""

    def __init__(self, out: Bus | None) -> None:
        self._out = out
        self._pending: dict[str, list[bytes]] = {}
        self._fed_s: dict[str, float] = {}
        self.now_s = 0.0

    def feed(self, topic: Topic[P], payload: P) -> None:
        self._pending.setdefault(topic.key, []).append(encode(payload, 1, 1))
        self._fed_s[topic.key] = self.now_s

    def publish(self, topic: Topic[P], payload: P, *, news: bool = True) -> None:
        if self._out is None:
            encode(payload, 1, 1)
        else:
            self._out.publish(topic, payload, news=news)

    def take(self, topic: Topic[P]) -> list[P]:
        return [decode(data, topic.payload).payload for data in self._pending.pop(topic.key, [])]

    def age_s(self, topic: Topic[Any]) -> float:
        return self.now_s - self._fed_s.get(topic.key, -math.inf)


class Drive:
    """The node with its worker; `report` publishes one report of the bridge and steps the node, as it makes it due."""

    def __init__(self, out: Bus | None) -> None:
        self.worker = ProcessWorker[Increment, Correction]("back end", BACK_END)
        self._node = MappingUnit(self.worker)
        self._bus = InputBus(out)
        self.step_s = array("d")

    def report(self, odometry: Odometry, ranges: Ranges) -> None:
        self._bus.now_s = odometry.t_s
        self._bus.feed(ODOMETRY, odometry)
        self._bus.feed(RANGES, ranges)
        began_s = time.thread_time()
        self._node.step(cast(Bus, self._bus), self._bus.now_s)
        self.step_s.append(time.thread_time() - began_s)

    def close(self) -> None:
        self._node.close()


def resident_mb(pid: int) -> float:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


def memory_mb(pid: int) -> tuple[float, float]:
    """Resident memory (RSS) and proportional share (PSS) of a process."""
    kb = {"Rss": 0, "Pss": 0}
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()[1:]:
        name, _, value = line.partition(":")
        if name in kb:
            kb[name] = int(value.split()[0])
    return kb["Rss"] / 1024, kb["Pss"] / 1024


def drive(marks_m: tuple[float, ...], pace: float) -> None:
    """Up to the last mark; prints a line at every one."""
    mesh = replace(Config().mesh, router=f"tcp/127.0.0.1:{reserve_port()}")  # where nobody is
    out = ZenohBus("mmu", replace(Config(), mesh=mesh), FreeClock())
    unit = Drive(out)
    print(HEAD, flush=True)
    ahead_s, peak_mb = time.monotonic(), 0.0
    marks, since = list(marks_m), 0
    try:
        for metres, odometry, ranges in Course().messages(marks_m[-1]):
            unit.report(odometry, ranges)
            ahead_s += 1.0 / SENSOR_RATE_HZ / pace
            time.sleep(max(0.0, ahead_s - time.monotonic()))
            peak_mb = max(peak_mb, resident_mb(os.getpid()) + resident_mb(unit.worker.pid))
            if metres >= marks[0]:
                print(_line(marks.pop(0), unit, since, peak_mb), flush=True)
                since = len(unit.step_s)
    finally:
        unit.close()
        out.close()


HEAD = (
    "  metres    steps  mean ms    p99  p99.9    max | RSS mmu  worker     sum  at most | PSS sum"
    "   (steps since the mark before)"
)


def _line(mark_m: float, unit: Drive, since: int, peak_mb: float) -> str:
    ms = 1000 * np.array(unit.step_s[since:])
    p99, p999 = np.percentile(ms, [99, 99.9])
    mine, its = memory_mb(os.getpid()), memory_mb(unit.worker.pid)
    return (
        f"{mark_m:8.0f} {len(ms):8d} {ms.mean():8.3f} {p99:6.2f} {p999:6.2f} {ms.max():6.2f} | "
        f"{mine[0]:7.1f} {its[0]:7.1f} {mine[0] + its[0]:7.1f} {peak_mb:8.1f} | {mine[1] + its[1]:7.1f}"
    )


def counted(steps: int) -> None:
    """So many steps as fast as they go, for `callgrind`."""
    course = Course().messages(math.inf)
    messages = [next(course) for _ in range(COUNTED_REPORTS[-1])]
    unit = Drive(None)
    for _, odometry, ranges in messages[:steps]:
        unit.report(odometry, ranges)
    unit.close()


def instructions_per_step() -> float | None:
    """By callgrind: the difference between a short drive and a longer one; None where valgrind is not there."""
    valgrind = shutil.which("valgrind")
    if valgrind is None:
        return None
    totals = []
    for reports in COUNTED_REPORTS:
        command = [valgrind, "--tool=callgrind", "--callgrind-out-file=/dev/null"]
        report = _run([*command, *_own_command("--count", str(reports))], capture_output=True, text=True).stderr
        totals.append(int(re.findall(r"Collected : (\d+)", report)[0]))
    return (totals[1] - totals[0]) / (COUNTED_REPORTS[1] - COUNTED_REPORTS[0])


def bench(order: Order) -> None:
    """Prints the figures: memory and time on the way, then instructions and what they mean for a BeagleBone."""
    marks = QUICK_MARKS_M if order.quick else MARKS_M
    _run(_own_command("--drive", ",".join(f"{mark:g}" for mark in marks)))
    count = instructions_per_step()
    if count is None:
        print("instructions per step: needs valgrind (apt install valgrind)")
        return
    slow, fast = (1000 * count * A8_INSTRUCTIONS / (A8_HZ * rate) for rate in A8_PER_CYCLE)
    period_ms = 1000 / SENSOR_RATE_HZ
    print(
        f"instructions per step {count / 1e6:.2f} million (callgrind, x86-64); on a Cortex-A8 at 1 GHz "
        f"{fast:.1f} to {slow:.1f} ms, that is {100 * fast / period_ms:.0f} to {100 * slow / period_ms:.0f} % "
        f"of the processor, if it takes {A8_INSTRUCTIONS:g} times as many instructions and does "
        f"{A8_PER_CYCLE[0]:g} to {A8_PER_CYCLE[1]:g} in a cycle"
    )


def _own_command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "deploy.bench.mapping_cost", *arguments]


def _run(command: list[str], **options: Any) -> subprocess.CompletedProcess[str]:
    environment = os.environ | PROCESS_ENVIRONMENT | {"PYTHONHASHSEED": "0"}
    return subprocess.run(command, check=True, env=environment, **options)


def main() -> None:
    parser = argparse.ArgumentParser(prog="mapping_cost", description="What the mapping unit costs on this machine.")
    parser.add_argument("--quick", action="store_true", help="100 m instead of a kilometre")
    parser.add_argument("--drive", metavar="M,...", help="only the drive, with a line at each of these metres")
    parser.add_argument("--pace", type=float, default=PACE, help=f"times real time ({PACE:g})")
    parser.add_argument("--count", type=int, metavar="REPORTS", help="only so many reports, for callgrind")
    arguments = parser.parse_args()
    if arguments.count is not None:
        counted(arguments.count)
    elif arguments.drive is not None:
        drive(tuple(map(float, arguments.drive.split(","))), arguments.pace)
    else:
        bench(arguments.quick)


if __name__ == "__main__":
    main()
