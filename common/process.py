"""A process of one node, or of several: arguments, configuration, log, clock, signals, and its exit code.

Exit codes: 0 ended as ordered, 1 unexpected error (in the log), 2 cannot begin as ordered (one sentence on stderr).
"""

from __future__ import annotations

import argparse
import ctypes
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import zenoh

from common import service_notify
from common.bus import Bus
from common.clock import Announcements, Clock, FollowerClock, FreeClock, LeaderClock
from common.config import Config
from common.config_file import load_config
from common.errors import StartError, sentence
from common.memory import keep_what_is_there
from common.messages.health import ClockAck, ClockTick
from common.messages.topics import CLOCK, CLOCK_ACK
from common.node import Node
from common.node_loop import Member, NodeLoop
from common.priority import leave_priority_to_comm
from common.process_log import BusLogHandler, set_up_log
from common.stop_signals import end_on_signals
from common.zenoh_bus import ZenohBus
from common.zenoh_channel import Mode
from common.zenoh_end import ZenohEnd
from common.zenoh_log import OF_A_PEER, OF_A_ROUTER, ZenohOutput
from common.zenoh_session import ROBOT_ROUTER, lease_s

_PR_SET_PDEATHSIG = 1
_LOOP_END_S = 2.0

Factory = Callable[[Config, argparse.Namespace], Node]
# Runs on the main thread while the node's loop runs on another one (a terminal UI); returns the exit code. It must
# return soon after the event is set: then the process shall end, or the node's loop has failed.
Foreground = Callable[[Node, Bus, threading.Event], int]


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
    return _Process(name, {name: factory}, arguments, mode, leads_clock).run(foreground)


def run_together(name: str, factories: Mapping[str, Factory], argv: list[str] | None = None) -> int:
    """Runs several nodes in one process `name` until SIGTERM, SIGINT or an error of one; returns the exit code.

    They share one session: the router's, where comm is among them. comm is stepped by a thread of its own, the others
    by one, in the order of `factories`.
    """
    arguments = argument_parser(name).parse_args(argv)
    mode: Mode = "router" if ROBOT_ROUTER in factories else "peer"
    return _Process(name, factories, arguments, mode, leads_clock=False).run(None)


class _Process:
    def __init__(
        self,
        name: str,
        factories: Mapping[str, Factory],
        arguments: argparse.Namespace,
        mode: Mode,
        leads_clock: bool,
    ) -> None:
        self._name, self._factories, self._arguments = name, factories, arguments
        self._mode, self._leads_clock = mode, leads_clock
        self._stop = threading.Event()
        self._end: ZenohEnd | None = None
        self._loops: list[NodeLoop] = []
        self._notifier = service_notify.from_environment(factories)

    def run(self, foreground: Foreground | None) -> int:
        if self._arguments.parent is not None:
            _end_with(self._arguments.parent)
        end_on_signals(self._stop)
        log = logging.getLogger(self._name)
        folder: Path | None = self._arguments.log_dir
        code, clean = 0, True
        try:
            # A foreground owns the terminal: no log line may appear there
            bus_log = set_up_log(self._name, tuple(self._factories), folder, to_terminal=foreground is None)
            self._open(bus_log, zenoh_to_log=foreground is None)
            log.info("started pid=%d config=%s", os.getpid(), self._arguments.config)
            if self._notifier is not None:
                self._notifier.ready()
            code = self._step_all(foreground)
            log.info("ended")
        except Exception as error:
            code = 2 if self._end is None and isinstance(error, (StartError, OSError)) else 1
            if code == 2:
                sys.stderr.write(f"{self._name}: {sentence(error)}\n")
            if code == 1 or folder is not None:
                log.error("cannot go on", exc_info=error)
        finally:
            if self._notifier is not None:
                self._notifier.stopping()
            try:
                for loop in self._loops:
                    loop.close(folder)
            finally:
                clean = self._end is None or self._end.close()
        if not clean:
            # Zenoh still waits for a frozen neighbour; its threads must not meet an interpreter that is being taken
            # down
            logging.shutdown()
            os._exit(code)
        return code

    def _open(self, bus_log: BusLogHandler, *, zenoh_to_log: bool) -> None:
        zenoh_output: ZenohOutput | None = None
        if zenoh_to_log:
            zenoh_output = ZenohOutput()
            zenoh.init_log_from_env_or(OF_A_ROUTER if self._mode == "router" else OF_A_PEER)
        config = load_config(self._arguments.config)
        nodes = [factory(config, self._arguments) for factory in self._factories.values()]
        session = ROBOT_ROUTER if ROBOT_ROUTER in self._factories else next(iter(self._factories))
        if self._leads_clock and self._arguments.clock == "shared":
            session = CLOCK.producer  # linked with everybody, so that the clock goes on whoever ends
        clocks = {loop: _make_clock(self._arguments, self._leads_clock) for loop in {_loop_of(n.name) for n in nodes}}
        lease = lease_s(session, next(iter(clocks.values())).lease_s)
        self._end = ZenohEnd(session, config, self._mode, lease, tuple(self._factories))
        for loop, clock in sorted(clocks.items()):
            of_loop = [node for node in nodes if _loop_of(node.name) == loop]
            buses = [ZenohBus(node.name, config, clock, self._mode, self._end) for node in of_loop]
            _join_clock(clock, buses)
            members = [Member(node, bus) for node, bus in zip(of_loop, buses, strict=True)]
            # One of them logs for all what Zenoh writes
            of_zenoh = None if self._loops else zenoh_output
            self._loops.append(NodeLoop(members, clock, bus_log, of_zenoh, self._notifier))
        keep_what_is_there()

    def _step_all(self, foreground: Foreground | None) -> int:
        """The loops, each in a thread of its own where there is more than one thing to run; the foreground here."""
        if foreground is None and len(self._loops) == 1:
            self._loops[0].run(self._stop)
            return 0
        failures: list[Exception] = []
        threads = [
            threading.Thread(target=self._step_one, args=(loop, failures), name=loop.name, daemon=True)
            for loop in self._loops
        ]
        for thread in threads:
            thread.start()
        try:
            code = 0
            if foreground is not None:
                first = self._loops[0].members[0]
                code = foreground(first.node, first.bus, self._stop)
            else:
                self._stop.wait()
        finally:
            self._stop.set()
            deadline_s = time.monotonic() + _LOOP_END_S
            for thread in threads:
                thread.join(max(0.0, deadline_s - time.monotonic()))
        if failures:
            raise failures[0]
        return code

    def _step_one(self, loop: NodeLoop, failures: list[Exception]) -> None:
        _name_thread(loop.name)
        if len(self._loops) > 1 and loop.name != ROBOT_ROUTER:
            leave_priority_to_comm()
        try:
            loop.run(self._stop)
        except Exception as error:
            failures.append(error)
        finally:
            self._stop.set()


def _loop_of(node: str) -> str:
    """Who is stepped by one thread, one after the other: all but comm, which watches over them."""
    return node if node == ROBOT_ROUTER else ""


def _name_thread(name: str) -> None:
    """For those who look at the machine: Python 3.11 keeps a thread's name to itself."""
    with suppress(OSError):
        Path(f"/proc/self/task/{threading.get_native_id()}/comm").write_text(name[:15], encoding="utf-8")


def _make_clock(arguments: argparse.Namespace, leads: bool) -> Clock:
    if arguments.clock == "free":
        return FreeClock()
    return LeaderClock(arguments.speed) if leads else FollowerClock()


def _join_clock(clock: Clock, buses: Sequence[ZenohBus]) -> None:
    """`buses` of the nodes that are stepped by this clock."""
    if isinstance(clock, FollowerClock):
        _follow(clock, buses)
    elif isinstance(clock, LeaderClock):
        _lead(clock, buses[0])


def _follow(clock: FollowerClock, buses: Sequence[ZenohBus]) -> None:
    announced, first = Announcements(), buses[0]
    expected = [(bus, Announcements()) for bus in buses]

    def receive(tick: ClockTick) -> None:
        for _, marks in expected:
            marks.merge((tick.topics, tick.boot_ids, tick.sequences))
        clock.tick(tick.t_s)

    def await_messages(stop: threading.Event) -> None:
        for bus, marks in expected:
            bus.await_messages(marks, stop)

    for bus in buses:
        bus.announced = announced
    clock.send_ack = lambda t_s: first.publish(CLOCK_ACK, ClockAck(t_s, first.name, *announced.take()))
    clock.await_messages = await_messages
    first.subscribe(CLOCK, receive)


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
