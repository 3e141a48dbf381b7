"""What the programs of the BeagleBone Black cost: the whole mesh as real processes at speed 1, on a mission.

The board has one Cortex-A8 at 1 GHz. Public single-board figures put CPython there 15 to 30 times slower than on a
core of today's laptops (no vector unit helps an interpreter): the share of a core here times that factor is the share
of the board's only core. Figures are printed for the factors 15, 20 and 30.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from math import nan
from pathlib import Path

from common.clock import FreeClock
from common.config import load_config
from common.messages import TOPICS
from common.modules import PACKAGES, Board, on
from common.zenoh_bus import ZenohBus
from deploy.bench.process_cost import GroupCost, Memory, between, command_line, family, memory, threads
from deploy.bench.waiting import BenchFailed, until
from deploy.local.report import read_steps
from offboard.evaluate.summary import StepTimes

FLOOR = "office"  # more than 40 m of hall
SETTLE_S = 20.0  # from the start of the mission, until the map is large enough to be worth something
WATCH_S, WATCH_QUICK_S = 60.0, 15.0
LISTEN_S = 10.0  # to the messages, after the figures of the processor were taken
CATCH_UP_S = 3.0  # what was published before comes at once
A8_FACTORS = (15, 20, 30)
_START_S = 60.0
_END_S = 20.0
_LISTEN_PERIOD_S = 0.05


@dataclass(frozen=True, slots=True)
class Traffic:
    """Messages that one process publishes, per second."""

    messages_hz: float
    bytes_s: float


class Mission:
    """`indoor-mapping local --headless` in a folder of its own."""

    def __init__(self, folder: Path) -> None:
        self._run, self._log = folder / "run", folder / "local.log"
        arguments = ["local", "--headless", "--floor", FLOOR, "--camera", "off", "--out", str(self._run)]
        with self._log.open("wb") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "deploy.cli", *arguments], stdout=log, stderr=subprocess.STDOUT
            )
        until(self._started, _START_S, "the start of the mission")

    def _started(self) -> bool:
        output = self._log.read_text(encoding="utf-8")
        if self._process.poll() is not None:
            raise BenchFailed(f"the mission did not start:\n{output}")
        return "The mission has started" in output

    @property
    def config_file(self) -> Path:
        return self._run / "process" / "robot.toml"

    def processes(self) -> dict[str, list[int]]:
        """Of every process of the board, with what it started itself."""
        modules = {PACKAGES[name]: name for name in on(Board.BEAGLEBONE)}
        found = {}
        for pid in family(self._process.pid):
            words = command_line(pid)
            name = next((modules[word] for word in words[1:4] if word in modules), None)
            if name is not None:
                found[name] = family(pid)
        return found

    def steps(self) -> dict[str, StepTimes]:
        """By process, once the mission has ended."""
        return read_steps(self.config_file.parent)

    def end(self) -> None:
        self._process.terminate()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()


def traffic(config_file: Path, listen_s: float) -> dict[str, Traffic]:
    """What is published, by process."""
    counts: dict[str, int] = defaultdict(int)
    sizes: dict[str, int] = defaultdict(int)
    bus = ZenohBus("bench", load_config(config_file), FreeClock())
    try:
        bus.record(TOPICS, {})
        begins_s = time.monotonic() + CATCH_UP_S
        while (now_s := time.monotonic()) < begins_s + listen_s:
            time.sleep(_LISTEN_PERIOD_S)
            messages = bus.take_recorded()
            for message in messages if now_s > begins_s else ():
                producer = message.key.split("/")[0]
                counts[producer] += 1
                sizes[producer] += len(message.data)
    finally:
        bus.close()
    return {name: Traffic(counts[name] / listen_s, sizes[name] / listen_s) for name in counts}


def bench(quick: bool) -> None:
    watch_s = WATCH_QUICK_S if quick else WATCH_S
    with tempfile.TemporaryDirectory(prefix="indoor-mapping-") as folder:
        mission = Mission(Path(folder))
        try:
            time.sleep(SETTLE_S)
            processes = mission.processes()
            began_s = time.monotonic()
            before = {name: threads(pids) for name, pids in processes.items()}
            time.sleep(watch_s)
            elapsed_s = time.monotonic() - began_s
            costs = {name: between(before[name], threads(pids), elapsed_s) for name, pids in processes.items()}
            sizes = {name: memory(pids) for name, pids in processes.items()}
            published = traffic(mission.config_file, LISTEN_S)
        finally:
            mission.end()
        steps = mission.steps()
    _print_costs(costs, sizes, published, steps)


def _print_costs(
    costs: Mapping[str, list[GroupCost]],
    sizes: Mapping[str, Memory],
    published: Mapping[str, Traffic],
    steps: Mapping[str, StepTimes],
) -> None:
    total = 0.0
    for name, groups in sorted(costs.items()):
        share = sum(group.cpu_share for group in groups)
        total += share
        sent = published.get(name, Traffic(0.0, 0.0))
        print(
            f"{name}: {100 * share:.2f} % of a core, {sum(g.wakeups_hz for g in groups):.0f} wake-ups/s, "
            f"{sent.messages_hz:.0f} messages/s of {sent.bytes_s / 1000:.1f} kB/s, "
            f"{sizes[name].resident_mb:.0f} MB resident ({sizes[name].proportional_mb:.0f} MB proportional), "
            f"longest step {steps[name].max_ms if name in steps else nan:.1f} ms"
        )
        for group in groups:
            print(f"    {group.threads} x {group.name}: {100 * group.cpu_share:.2f} %, {group.wakeups_hz:.0f}/s")
    shares = ", ".join(f"{100 * total * factor:.0f} % at {factor} times" for factor in A8_FACTORS)
    proportional_mb = sum(size.proportional_mb for size in sizes.values())
    print(
        f"together: {100 * total:.2f} % of a core here, of a Cortex-A8 {shares}; {proportional_mb:.0f} MB proportional"
    )
