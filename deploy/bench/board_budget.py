"""What the programs of the BeagleBone Black cost: the whole mesh as real processes at speed 1, on a mission.

The board has one Cortex-A8 at 1 GHz. Public single-board figures put CPython there 15 to 30 times slower than on a
core of today's laptops (no vector unit helps an interpreter): the share of a core here times that factor is the share
of the board's only core. Figures are printed for the factors 15, 20 and 30.

Against another checkout the two take turns, and each is measured from outside: what counts is the ratio, since a busy
machine makes both dearer.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from common.clock import FreeClock
from common.config_file import load_config
from common.messages.topics import TOPICS
from common.zenoh_bus import ZenohBus
from deploy.bench.mission import HERE, Mission
from deploy.bench.order import Order
from deploy.bench.process_cost import GroupCost, Memory, between, memory, niceness, threads
from deploy.local.report import read_steps
from offboard.evaluate.summary import StepTimes

SETTLE_S = 20.0  # from the start of the mission, until the map is large enough to be worth something
WATCH_S, WATCH_QUICK_S = 60.0, 15.0
LISTEN_S = 10.0  # to the messages, after the figures of the processor were taken
CATCH_UP_S = 3.0  # what was published before comes at once
A8_FACTORS = (15, 20, 30)
_LISTEN_PERIOD_S = 0.05


@dataclass(frozen=True, slots=True)
class Traffic:
    """Messages that one module publishes, per second."""

    messages_hz: float
    bytes_s: float


@dataclass(frozen=True, slots=True)
class ProgramCost:
    """One program of the board, or what it started itself."""

    groups: list[GroupCost]  # its threads by name
    memory: Memory
    nice: int | None

    @property
    def cpu_share(self) -> float:
        """Of one core."""
        return sum(group.cpu_share for group in self.groups)

    @property
    def wakeups_hz(self) -> float:
        return sum(group.wakeups_hz for group in self.groups)


Costs = Mapping[str, ProgramCost]


def watch(mission: Mission, watch_s: float) -> Costs:
    """By program, over so long; what ends meanwhile is not counted."""
    before = {name: threads(pids) for name, pids in mission.programs().items()}
    began_s = time.monotonic()
    time.sleep(watch_s)
    elapsed_s = time.monotonic() - began_s
    return {
        name: ProgramCost(between(before.get(name, {}), threads(pids), elapsed_s), memory(pids), niceness(pids[0]))
        for name, pids in mission.programs().items()
    }


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


def bench(order: Order) -> None:
    watch_s = WATCH_QUICK_S if order.quick else WATCH_S
    with tempfile.TemporaryDirectory(prefix="indoor-mapping-") as folder:
        if order.against is None:
            _alone(Path(folder), watch_s)
        else:
            _by_turns(Path(folder), order.against.resolve(), order.pairs, watch_s)


def _alone(folder: Path, watch_s: float) -> None:
    mission = Mission(folder)
    try:
        time.sleep(SETTLE_S)
        costs = watch(mission, watch_s)
        published = traffic(mission.config_file, LISTEN_S)
    finally:
        mission.end()
    _print_costs(costs)
    _print_modules(published, read_steps(mission.work))


def _by_turns(folder: Path, other: Path, pairs: int, watch_s: float) -> None:
    ratios: list[float] = []
    shares: dict[Path, list[float]] = {HERE: [], other: []}
    for number in range(1, pairs + 1):
        for tree in (other, HERE):
            mission = Mission(folder / f"{tree.name}-{number}", tree)
            try:
                time.sleep(SETTLE_S)
                costs = watch(mission, watch_s)
            finally:
                mission.end()
            shares[tree].append(_sum(costs))
            print(f"{number}: {tree}\n    {_summary(costs)}", flush=True)
        ratios.append(shares[other][-1] / shares[HERE][-1])
    for tree, of in shares.items():
        print(f"{tree}: median {100 * statistics.median(of):.2f} % of a core ({_span([100 * x for x in of])})")
    print(f"the other costs {statistics.median(ratios):.2f} times as much, median of {pairs} pairs ({_span(ratios)})")


def _sum(costs: Costs) -> float:
    return sum(cost.cpu_share for cost in costs.values())


def _span(values: list[float]) -> str:
    return f"{min(values):.2f} to {max(values):.2f}"


def _summary(costs: Costs) -> str:
    share = _sum(costs)
    of_board = ", ".join(f"{100 * share * factor:.0f} % at {factor} times" for factor in A8_FACTORS)
    wakeups_hz = sum(cost.wakeups_hz for cost in costs.values())
    resident_mb = sum(cost.memory.resident_mb for cost in costs.values())
    proportional_mb = sum(cost.memory.proportional_mb for cost in costs.values())
    return (
        f"together: {100 * share:.2f} % of a core here, of a Cortex-A8 {of_board}; {wakeups_hz:.0f} wake-ups/s, "
        f"{proportional_mb:.0f} MB proportional ({resident_mb:.0f} MB resident)"
    )


def _print_costs(costs: Costs) -> None:
    for name, cost in sorted(costs.items()):
        print(
            f"{name}: {100 * cost.cpu_share:.2f} % of a core, {cost.wakeups_hz:.0f} wake-ups/s, "
            f"{cost.memory.resident_mb:.0f} MB resident ({cost.memory.proportional_mb:.0f} MB proportional)"
            + (f", nice {cost.nice}" if cost.nice else "")
        )
        for group in cost.groups:
            print(f"    {group.threads} x {group.name}: {100 * group.cpu_share:.2f} %, {group.wakeups_hz:.0f}/s")
    print(_summary(costs))


def _print_modules(published: Mapping[str, Traffic], steps: Mapping[str, StepTimes]) -> None:
    for name in sorted(published.keys() | steps.keys()):
        parts = []
        if name in published:
            sent = published[name]
            parts.append(f"{sent.messages_hz:.0f} messages/s of {sent.bytes_s / 1000:.1f} kB/s")
        if name in steps:
            step = steps[name]
            parts.append(
                f"steps: mean {step.mean_ms:.2f}, p99 {step.p99_ms:.1f}, p99.9 {step.p999_ms:.1f}, "
                f"longest {step.max_ms:.1f} ms of processor time"
            )
        print(f"{name}: {'; '.join(parts)}")
