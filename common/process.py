"""One process = one node: arguments, configuration, log, clock, signals, the rate of its steps, and its exit code.

Exit codes: 0 ended as ordered, 1 unexpected error (in the log), 2 cannot begin as ordered (one sentence on stderr).
"""

from __future__ import annotations

import argparse
import ctypes
import json
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import zenoh

from common.alarm import Alarm
from common.bus import Bus
from common.clock import Announcements, Clock, FollowerClock, FreeClock, LeaderClock
from common.config import Config, load_config
from common.errors import StartError, sentence
from common.messages import CLOCK, CLOCK_ACK, LOG, ClockAck, ClockTick
from common.node import Agenda, FileNode, Node
from common.process_log import BusLogHandler, set_up_log
from common.zenoh_bus import ZenohBus
from common.zenoh_log import OF_A_PEER, OF_A_ROUTER, ZenohOutput
from common.zenoh_session import Mode

_PR_SET_PDEATHSIG = 1
_CATCH_UP_S = 0.1  # a node that is later than this, and than five periods, logs it
_STEPS_KEPT = 50_000  # of the newest steps, for the percentile
_LOOP_END_S = 2.0
STEPS_SUFFIX = ".steps.json"

Factory = Callable[[Config, argparse.Namespace], Node]
# Runs on the main thread while the node's loop runs on another one (a terminal UI); returns the exit code. It must
# return soon after the event is set: then the process shall end, or the node's loop has failed.
Foreground = Callable[[Node, Bus, threading.Event], int]


class StepTimer:
    """How long the steps of a node took, in `<name>.steps.json` at the end."""

    def __init__(self) -> None:
        self._recent_s = np.zeros(_STEPS_KEPT, np.float32)  # a ring, whole from the beginning: memory does not grow
        self._count, self._sum_s, self._max_s = 0, 0.0, 0.0

    def add(self, duration_s: float) -> None:
        self._recent_s[self._count % _STEPS_KEPT] = duration_s
        self._count += 1
        self._sum_s += duration_s
        self._max_s = max(self._max_s, duration_s)

    def write(self, file: Path) -> None:
        """Nothing when there was no step; raises OSError."""
        if not self._count:
            return
        p99_s = float(np.percentile(self._recent_s[: self._count], 99))
        figures = {"mean_ms": self._sum_s / self._count, "p99_ms": p99_s, "max_ms": self._max_s}
        content = {name: round(1000 * value_s, 4) for name, value_s in figures.items()} | {"count": self._count}
        file.write_text(json.dumps(content) + "\n", encoding="utf-8")


def argument_parser(name: str) -> argparse.ArgumentParser:
    """The arguments that every process takes; a process may add its own before `run`."""
    parser = argparse.ArgumentParser(prog=name)
    parser.add_argument("--config", type=Path, help="robot.toml; without it, the defaults")
    parser.add_argument("--log-dir", type=Path, help="folder for the log file and for what must outlive a restart")
    parser.add_argument("--clock", choices=("free", "shared"), default="free")
    parser.add_argument("--speed", type=float, default=1.0, help="pace of the shared clock, for the one that leads it")
    parser.add_argument("--parent", type=int, help="process id with whose end this one ends")
    return parser


def run(
    name: str,
    factory: Factory,
    argv: list[str] | None = None,
    *,
    parser: argparse.ArgumentParser | None = None,
    mode: Mode = "peer",
    leads_clock: bool = False,
    foreground: Foreground | None = None,
) -> int:
    """Runs one node until SIGTERM, SIGINT, an error or the end of its foreground; returns the exit code."""
    arguments = (parser or argument_parser(name)).parse_args(argv)
    if arguments.parent is not None:
        _end_with(arguments.parent)
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    log = logging.getLogger(name)
    node: Node | None = None
    bus: ZenohBus | None = None
    code, clean = 0, True
    steps = StepTimer()
    try:
        # A foreground owns the terminal: no log line may appear there
        bus_log = set_up_log(name, arguments.log_dir, to_terminal=foreground is None)
        zenoh_output: ZenohOutput | None = None
        if foreground is None:
            zenoh_output = ZenohOutput()
            zenoh.init_log_from_env_or(OF_A_ROUTER if mode == "router" else OF_A_PEER)
        config = load_config(arguments.config)
        node = factory(config, arguments)
        clock = _make_clock(arguments, leads_clock)
        bus = ZenohBus(name, config, clock, mode)
        _join_clock(clock, bus, name)
        log.info("started pid=%d config=%s", os.getpid(), arguments.config)
        loop = partial(_loop, node, bus, clock, stop, bus_log, zenoh_output, steps)
        if foreground is None:
            loop()
        else:
            code = _run_beside(loop, partial(foreground, node, bus, stop), stop)
        log.info("ended")
    except Exception as error:
        code = 2 if bus is None and isinstance(error, (StartError, OSError)) else 1
        if code == 2:
            sys.stderr.write(f"{name}: {sentence(error)}\n")
        if code == 1 or arguments.log_dir is not None:
            log.error("cannot go on", exc_info=error)
    finally:
        try:
            if node is not None:
                node.close()
            if arguments.log_dir is not None:
                steps.write(arguments.log_dir / f"{name}{STEPS_SUFFIX}")
        finally:
            clean = bus is None or bus.close()
    if not clean:
        # Zenoh still waits for a frozen neighbour; its threads must not meet an interpreter that is being taken down
        logging.shutdown()
        os._exit(code)
    return code


def _run_beside(loop: Callable[[], None], foreground: Callable[[], int], stop: threading.Event) -> int:
    """The loop in a thread, the foreground here; what the loop dies of is raised here."""
    failures: list[Exception] = []

    def guarded() -> None:
        try:
            loop()
        except Exception as error:
            failures.append(error)
        finally:
            stop.set()

    thread = threading.Thread(target=guarded, name="node", daemon=True)
    thread.start()
    try:
        code = foreground()
    finally:
        stop.set()
        thread.join(_LOOP_END_S)
    if failures:
        raise failures[0]
    return code


def _loop(
    node: Node,
    bus: ZenohBus,
    clock: Clock,
    stop: threading.Event,
    bus_log: BusLogHandler,
    zenoh_output: ZenohOutput | None,
    steps: StepTimer,
) -> None:
    log = logging.getLogger(node.name)
    alarm = Alarm(node.fileno) if isinstance(node, FileNode) else Alarm()
    bus.wake_on(node.wakes_on, alarm.ring)
    agenda = Agenda(node, clock.begin(stop))
    late = False
    while True:
        now_s = clock.wait(agenda, alarm, stop)
        if stop.is_set():
            return
        alarm.reset()
        was_late, late = late, now_s - agenda.due_s > max(_CATCH_UP_S, 5 * node.period_s)
        if late and not was_late:
            log.warning("late behind_s=%.3f period_s=%.3f", now_s - agenda.due_s, node.period_s)
        began_s = time.perf_counter()
        agenda.stepped(now_s, node.step(bus, now_s))
        steps.add(time.perf_counter() - began_s)
        if zenoh_output is not None:
            zenoh_output.report(now_s)
        if node.name in LOG:
            bus_log.flush_to(bus, node.name, now_s)


def _make_clock(arguments: argparse.Namespace, leads: bool) -> Clock:
    if arguments.clock == "free":
        return FreeClock()
    return LeaderClock(arguments.speed) if leads else FollowerClock()


def _join_clock(clock: Clock, bus: ZenohBus, name: str) -> None:
    if isinstance(clock, FollowerClock):
        _follow(clock, bus, name)
    elif isinstance(clock, LeaderClock):
        _lead(clock, bus)


def _follow(clock: FollowerClock, bus: ZenohBus, name: str) -> None:
    announced, expected = Announcements(), Announcements()

    def receive(tick: ClockTick) -> None:
        expected.merge((tick.topics, tick.boot_ids, tick.sequences))
        clock.tick(tick.t_s)

    bus.announced = announced
    clock.send_ack = lambda t_s: bus.publish(CLOCK_ACK, ClockAck(t_s, name, *announced.take()))
    clock.await_messages = lambda stop: bus.await_messages(expected, stop)
    bus.subscribe(CLOCK, receive)


def _lead(clock: LeaderClock, bus: ZenohBus) -> None:
    announced = Announcements()

    def receive(ack: ClockAck) -> None:
        announced.merge((ack.topics, ack.boot_ids, ack.sequences))
        clock.ack(ack.module, ack.t_s)

    clock.send_tick = lambda t_s: bus.publish(CLOCK, ClockTick(t_s, clock.speed, *announced.take()))
    bus.subscribe(CLOCK_ACK, receive)


def _end_with(parent: int) -> None:
    """The kernel kills this process when its parent ends, however that ends."""
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        sys.exit(0)
