"""A mission whose programs of the BeagleBone share one core at a fraction of its speed, laptop and simulator apart.

Speed 1, so robot time is time. Once the mission has started, the programs are pinned to one core, which is slowed 10,
15 and 19 times; as root they have the priorities of their units. From then on are counted: permits that comm withdraws
and how often the firmware switches its motor driver off for want of heartbeats, though nobody stopped the robot; and
what a person's stop takes from the command until the motors of the simulated body are off. How much of the slow core
the programs use tells whether they fit at all. Whether the mission goes on is what the planner reports at the end.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

from common.clock import FreeClock
from common.config import Config
from common.config_file import load_config
from common.messages.mission import Operation
from common.messages.stop import Permit
from common.messages.topics import PERMIT, PLAN
from common.modules import ON_ROBOT
from common.zenoh_bus import ZenohBus
from common.zenoh_session import ROBOT_ROUTER
from deploy.bench.core_quota import ThrottledCore, cores, pin, throttled_core
from deploy.bench.machine import percentiles
from deploy.bench.mission import FLOOR, Mission
from deploy.bench.order import Order
from deploy.bench.process_cost import threads
from deploy.bench.waiting import BenchFailed
from deploy.boards.units import niceness
from offboard.operate import operations
from offboard.operate.operator_client import operate, press_stop, request_release
from offboard.operate.software_stop import Demand
from offboard.simulator.run.process import MOTORS_NAME

# Not 20: the kernel keeps a twentieth of each second for processes of the usual priority, and gives it in one piece
FACTORS, FACTORS_QUICK = (10.0, 15.0, 19.0), (15.0,)
WATCH_S, WATCH_QUICK_S = 900.0, 60.0  # at most; it ends with the mission
SETTLE_S = 10.0  # after the core became slow: what was due meanwhile is done
STOP_EVERY_S = 20.0
STOP_TO_WHEELS_OFF_S = 0.5  # at most, on the robot
_POLL_S = 0.02
_PIN_EVERY_S = 1.0
_DRIVING_AGAIN_S = 30.0

MotorRow = tuple[float, int, int, bool]  # t_s, PWM left and right, driver enabled


@dataclass(slots=True)
class Withdrawn:
    """Permits that were withdrawn, by reason, from the messages in their order. Pure."""

    reasons: Counter[str] = field(default_factory=Counter)
    _granted: bool = False

    def permit(self, permit: Permit) -> None:
        if self._granted and not permit.granted:
            self.reasons[permit.reason] += 1
        self._granted = permit.granted

    def forget(self) -> None:
        """A person has stopped the robot: that there is no permit until the next one counts for nothing."""
        self._granted = False


def switched_off(rows: Sequence[MotorRow], spans_s: Sequence[tuple[float, float]]) -> int:
    """How often the driver was switched off within these spans of time: the firmware does so without heartbeats."""
    return sum(
        before[3] and not now[3] and any(low <= now[0] <= high for low, high in spans_s)
        for before, now in pairwise(rows)
    )


def wheels_off_s(rows: Sequence[MotorRow], pressed_s: float) -> float | None:
    """How long after the command both motors and their driver were off; None where they were off before, or never."""
    before = [row for row in rows if row[0] <= pressed_s]
    if not before or _is_off(before[-1]):
        return None
    return next((row[0] - pressed_s for row in rows if row[0] > pressed_s and _is_off(row)), None)


def _is_off(row: MotorRow) -> bool:
    return row[1:] == (0, 0, False)


def prioritise(pids: Iterable[int], nice: int) -> None:
    """All threads of these processes, where that is permitted."""
    for thread in threads(pids):
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, thread, nice)


def read_motors(file: Path) -> list[MotorRow]:
    """What the simulator wrote of the motors so far."""
    rows = [line.split(",") for line in file.read_text(encoding="utf-8").splitlines()[1:]]
    return [(float(t), int(left), int(right), on == "1") for t, left, right, on in rows if on]


class Watch:
    """One mission on a slow core, seen from the laptop."""

    def __init__(self, mission: Mission, core: ThrottledCore, others: set[int]) -> None:
        self._mission, self._core, self._others = mission, core, others
        self._bus = ZenohBus("command_center", load_config(mission.config_file), FreeClock(), "client")
        self.withdrawn = Withdrawn()
        self.unstopped_s: list[tuple[float, float]] = []  # spans of time in which nobody stopped the robot
        self.stops_s: list[float] = []
        self.unconfirmed = 0
        self._pin_due_s = self._free_since_s = 0.0
        self._counted_s = 0.0
        self._cpu_s: dict[int, float] = {}  # of each thread, when `settle` ended

    def close(self) -> None:
        self._bus.close()

    def run(self, watch_s: float) -> None:
        """Watches, and stops the robot now and then; ends with the mission."""
        begin_s = self._free_since_s = time.monotonic()
        stop_due_s = begin_s + STOP_EVERY_S
        while (now_s := time.monotonic()) < begin_s + watch_s and self._goes_on():
            self.look()
            if now_s >= stop_due_s and self._drives():
                self._stop()
                stop_due_s = time.monotonic() + STOP_EVERY_S
            time.sleep(_POLL_S)
        self.unstopped_s.append((self._free_since_s, time.monotonic()))

    def settle(self) -> None:
        end_s = time.monotonic() + SETTLE_S
        while time.monotonic() < end_s:
            self.look()
            time.sleep(_POLL_S)
        self.withdrawn = Withdrawn()
        self._counted_s, self._cpu_s = time.monotonic(), self._threads_cpu_s()

    def used(self) -> float:
        """Which part of the core at its full speed the programs have used since `settle`."""
        used_s = sum(cpu_s - self._cpu_s.get(thread, 0.0) for thread, cpu_s in self._threads_cpu_s().items())
        return used_s / (time.monotonic() - self._counted_s)

    def look(self) -> None:
        """Takes what came, and keeps every process where it belongs: one that was restarted as well."""
        now_s = time.monotonic()
        if now_s >= self._pin_due_s:
            self._pin_due_s = now_s + _PIN_EVERY_S
            programs = self._mission.programs()
            of_board = {pid for pids in programs.values() for pid in pids}
            self._core.add(of_board)
            for name in programs.keys() & ON_ROBOT:  # what shares a process lowers the priority of its threads itself
                prioritise(programs[name], niceness(name))
            pin(set(self._mission.all_processes()) - of_board, self._others)
        for permit in self._bus.take(PERMIT):
            self.withdrawn.permit(permit)

    def progress(self) -> str:
        view = self._bus.latest(PLAN)
        if view is None:
            return "the planner is silent"
        return f"{view.detail}, {view.area_m2:.0f} m2 mapped, outcome {view.outcome.value}"

    def _threads_cpu_s(self) -> dict[int, float]:
        pids = [pid for pids in self._mission.programs().values() for pid in pids]
        return {thread: cost.cpu_s for thread, cost in threads(pids).items()}

    def _goes_on(self) -> bool:
        view = self._bus.latest(PLAN)
        return self._mission.running and not (view is not None and view.outcome.ends_mission)

    def _drives(self) -> bool:
        rows = read_motors(self._mission.work / MOTORS_NAME)
        return bool(rows) and not _is_off(rows[-1])

    def _stop(self) -> None:
        """Stop, release, resume; waits until it drives again."""
        self.withdrawn.forget()
        pressed_s = time.monotonic()
        self.unstopped_s.append((self._free_since_s, pressed_s))
        control = press_stop(self._bus)
        if control.latency_s is None:
            self.unconfirmed += 1
        time.sleep(STOP_TO_WHEELS_OFF_S)
        took_s = wheels_off_s(read_motors(self._mission.work / MOTORS_NAME), pressed_s)
        if took_s is not None:
            self.stops_s.append(took_s)
        if request_release(self._bus).demand is not Demand.NONE:
            self.unconfirmed += 1
        operate(self._bus, operations.Order(Operation.RESUME))
        self._bus.take(PERMIT)
        deadline_s = time.monotonic() + _DRIVING_AGAIN_S
        while not self._drives() and time.monotonic() < deadline_s:
            time.sleep(_POLL_S)
        self._free_since_s = time.monotonic()

    def disarmed(self) -> int:
        """How often the heartbeats stayed away."""
        return switched_off(read_motors(self._mission.work / MOTORS_NAME), self.unstopped_s)


def bench(order: Order) -> None:
    core, others = cores()
    for factor in FACTORS_QUICK if order.quick else FACTORS:
        with tempfile.TemporaryDirectory(prefix="indoor-mapping-") as folder:
            _one(Path(folder), factor, core, others, WATCH_QUICK_S if order.quick else WATCH_S)


def _one(folder: Path, factor: float, core: int, others: set[int], watch_s: float) -> None:
    mission = Mission(folder, nice=niceness(Config().process_of(ROBOT_ROUTER)))
    slowed = throttled_core(core, factor)
    watch: Watch | None = None
    try:
        pin([*mission.all_processes()], others)
        watch = Watch(mission, slowed, others)
        began_s = time.monotonic()
        watch.settle()
        watch.run(watch_s)
        seconds = time.monotonic() - began_s
        _report(f"{factor:.0f} times slower ({slowed.what}), {FLOOR}, {seconds:.0f} s", watch, factor)
    except BenchFailed as failure:
        print(f"{factor:.0f} times slower: {failure}", flush=True)
    finally:
        slowed.close()
        if watch is not None:
            watch.close()
        mission.end()


def _report(head: str, watch: Watch, factor: float) -> None:
    withdrawn = watch.withdrawn.reasons
    reasons = "".join(f"\n        {count} x {reason}" for reason, count in withdrawn.most_common(5))
    stops = "none came" if not watch.stops_s else f"{percentiles(watch.stops_s)} of {len(watch.stops_s)}"
    late = sum(took_s > STOP_TO_WHEELS_OFF_S for took_s in watch.stops_s)
    print(
        f"{head}:\n    used of the slow core: {100 * factor * watch.used():.0f} %\n"
        f"    permits withdrawn: {withdrawn.total()}{reasons}\n"
        f"    motors switched off for want of heartbeats: {watch.disarmed()}\n"
        f"    stop to wheels off: {stops}, {late} of them later than {STOP_TO_WHEELS_OFF_S} s; "
        f"{watch.unconfirmed} commands unconfirmed\n    the mission: {watch.progress()}",
        flush=True,
    )
