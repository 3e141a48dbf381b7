"""`ZenohBus` against bare Zenoh sessions of the same settings: latency and processor time, in one run.

Two processes each, joined as on the robot, take turns. Both senders make a pose and publish it; the bare one sends its
time and as many bytes as the encoded pose has. Bare Zenoh hands over bytes and has no idea what is in them: encoding,
numbering, keeping the newest for the recorder and decoding are all overhead of ours. Both receivers take the time on
Zenoh's thread, or take what came in steps of the same length.
"""

from __future__ import annotations

import multiprocessing
import os
import struct
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, Protocol

import numpy as np
import zenoh

from common.clock import FreeClock
from common.codec import decode, encode
from common.config import Config, MeshSection, apart
from common.messages.mapping import PoseEstimate
from common.messages.topics import POSE
from common.zenoh_bus import ZenohBus
from common.zenoh_channel import open_session
from common.zenoh_session import lease_s, main_channel
from deploy.bench.machine import percentiles
from deploy.bench.order import Order
from deploy.local.ports import reserve_port

LATENCY_PERIOD_S = 0.005
LATENCY_COUNT = 200  # per round: short turns, so that a machine with other work to do is as busy for both
LOAD_PERIOD_S = 0.001
LOAD_COUNT = 600
STEP_S = 0.01  # of the node that takes what came, and is busy for its whole step with nothing else
WARM_UP = 200  # messages of which none counts
ROUNDS, ROUNDS_QUICK = 25, 10
_SETTLE_S = 1.0


class End(Protocol):
    """One end of a pair."""

    def publish(self, pose: PoseEstimate) -> None: ...

    def listen(self, handler: Callable[[float], None]) -> None:
        """Hands over the time of every pose, on Zenoh's thread."""

    def take(self) -> int:
        """How many came since the last call, as a node takes them."""

    def close(self) -> Any: ...


def _pose(t_s: float) -> PoseEstimate:
    return PoseEstimate(t_s, 1.25, -3.5, 0.75, 0.75, 0.02, 0.01, 3)


class OurEnd:
    def __init__(self, name: str, config: Config) -> None:
        self._bus = ZenohBus(name, config, FreeClock())
        self.close = self._bus.close

    def publish(self, pose: PoseEstimate) -> None:
        self._bus.publish(POSE, pose)

    def listen(self, handler: Callable[[float], None]) -> None:
        self._bus.subscribe(POSE, lambda pose: handler(pose.t_s))

    def take(self) -> int:
        return len(self._bus.take(POSE))


class BareEnd:
    def __init__(self, name: str, config: Config) -> None:
        self._session = open_session(main_channel(name, "peer", config), lease_s(name, FreeClock.lease_s))
        self._key = f"bare/{POSE.key}"
        self._publisher = self._session.declare_publisher(
            self._key, priority=zenoh.Priority.DATA_HIGH, congestion_control=zenoh.CongestionControl.DROP
        )
        self._filling = bytes(len(encode(_pose(time.monotonic()), 1000, 1 << 47)) - 8)
        self._came: deque[bytes] = deque()
        self._subscriber: Any = None

    def publish(self, pose: PoseEstimate) -> None:
        self._publisher.put(struct.pack("<d", pose.t_s) + self._filling)

    def listen(self, handler: Callable[[float], None]) -> None:
        self._subscribe(lambda sample: handler(struct.unpack_from("<d", bytes(sample.payload))[0]))

    def take(self) -> int:
        if self._subscriber is None:
            self._subscribe(lambda sample: self._came.append(bytes(sample.payload)))
        count = 0
        while self._came:
            self._came.popleft()
            count += 1
        return count

    def close(self) -> Any:
        return self._session.close()  # type: ignore[no-untyped-call]

    def _subscribe(self, receive: Callable[[Any], None]) -> None:
        direct = zenoh.handlers.Callback(receive, indirect=False)
        self._subscriber = self._session.declare_subscriber(self._key, direct)


ENDS: dict[str, Callable[[str, Config], End]] = {"ours": OurEnd, "bare": BareEnd}


@dataclass(slots=True)
class Figures:
    """Of one kind of pair, all rounds together."""

    latencies_s: list[float]
    sending_s: list[float]  # processor time per message, one value per round
    receiving_s: list[float]


def _sender(kind: str, config: Config, orders: Connection) -> None:
    """Sends so many messages in such a period on request; replies with the processor time they took."""
    end = ENDS[kind]("mmu", config)
    end.publish(_pose(0.0))
    try:
        while order := orders.recv():
            count, period_s = order
            began_s, due_s = time.process_time(), time.monotonic()
            for _ in range(count):
                due_s += period_s
                time.sleep(max(0.0, due_s - time.monotonic()))
                end.publish(_pose(time.monotonic()))
            orders.send(time.process_time() - began_s)
    finally:
        end.close()


def _receiver(kind: str, config: Config, orders: Connection, by_steps: bool) -> None:
    """On request: (latencies, messages taken, processor time) since the request before."""
    end = ENDS[kind]("poi", config)
    latencies_s: list[float] = []
    if not by_steps:
        end.listen(lambda sent_s: latencies_s.append(time.monotonic() - sent_s))
    count, began_s = 0, time.process_time()
    with suppress(EOFError):
        while True:
            if by_steps:
                count += end.take()
            if orders.poll(STEP_S):
                if orders.recv() is None:
                    break
                came, latencies_s[:] = latencies_s[:], []
                now_s = time.process_time()
                orders.send((came, count, now_s - began_s))
                count, began_s = 0, now_s
    end.close()


class Pair:
    """Sender and receiver of one kind."""

    def __init__(self, kind: str, config: Config, *, by_steps: bool) -> None:
        processes = multiprocessing.get_context("spawn")
        self._to_sender, sender = processes.Pipe()
        self._to_receiver, receiver = processes.Pipe()
        self._processes = [
            processes.Process(target=_sender, args=(kind, config, sender), daemon=True),
            processes.Process(target=_receiver, args=(kind, config, receiver, by_steps), daemon=True),
        ]
        for process in self._processes:
            process.start()
        self._request()
        time.sleep(_SETTLE_S)  # both are there; until they have found each other
        self.run(WARM_UP, LATENCY_PERIOD_S)

    def run(self, count: int, period_s: float) -> tuple[list[float], int, float, float]:
        """Latencies, how many came, processor time of sender and receiver (s)."""
        self._request()
        self._to_sender.send((count, period_s))
        sending_s = self._to_sender.recv()
        time.sleep(5 * STEP_S)
        came, taken, receiving_s = self._request()
        return came, taken, sending_s, receiving_s

    def close(self) -> None:
        for orders in (self._to_sender, self._to_receiver):
            orders.send(None)
        for process in self._processes:
            process.join(5.0)

    def _request(self) -> tuple[list[float], int, float]:
        self._to_receiver.send("report")
        answer: tuple[list[float], int, float] = self._to_receiver.recv()
        return answer


def measure(rounds: int) -> dict[str, Figures]:
    """Both kinds by turns, so that other load on the machine affects both."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    configs = {kind: apart(Config(mesh=MeshSection(f"tcp/127.0.0.1:{reserve_port()}"))) for kind in ENDS}
    figures = {kind: Figures([], [], []) for kind in ENDS}
    with ExitStack() as routers:
        for config in configs.values():
            routers.enter_context(open_session(main_channel("comm", "router", config), FreeClock.lease_s))
        for by_steps in (False, True):
            pairs = {kind: Pair(kind, config, by_steps=by_steps) for kind, config in configs.items()}
            for _ in range(rounds):
                for kind, pair in pairs.items():
                    if by_steps:
                        _, taken, sending_s, receiving_s = pair.run(LOAD_COUNT, LOAD_PERIOD_S)
                        figures[kind].sending_s.append(sending_s / LOAD_COUNT)
                        figures[kind].receiving_s.append(receiving_s / max(taken, 1))
                    else:
                        figures[kind].latencies_s += pair.run(LATENCY_COUNT, LATENCY_PERIOD_S)[0]
            for pair in pairs.values():
                pair.close()
    return figures


def bench(order: Order) -> None:
    figures = measure(ROUNDS_QUICK if order.quick else ROUNDS)
    for kind, found in figures.items():
        sending_us, receiving_us = 1e6 * np.median(found.sending_s), 1e6 * np.median(found.receiving_s)
        print(f"{kind}: latency of {len(found.latencies_s)} messages {percentiles(found.latencies_s, 'us')}")
        print(f"      processor per message: sender {sending_us:.0f}, receiver {receiving_us:.0f} us")
    ours, bare = figures["ours"], figures["bare"]
    p50, p99 = np.percentile(ours.latencies_s, [50, 99]) / np.percentile(bare.latencies_s, [50, 99])
    cost = [np.median(f.sending_s) + np.median(f.receiving_s) for f in (ours, bare)]
    print(f"ours / bare: latency p50 {p50:.2f}, p99 {p99:.2f}; processor {cost[0] / cost[1]:.2f}")
    print(f"of that: encode {1e6 * _time_of_encode():.0f} us, decode {1e6 * _time_of_decode():.0f} us")


def _time_of_encode(count: int = 5000) -> float:
    pose, began_s = _pose(1.0), time.perf_counter()
    for number in range(count):
        encode(pose, number, 1 << 47)
    return (time.perf_counter() - began_s) / count


def _time_of_decode(count: int = 5000) -> float:
    data, began_s = encode(_pose(1.0), 1, 1 << 47), time.perf_counter()
    for _ in range(count):
        decode(data, POSE.payload)
    return (time.perf_counter() - began_s) / count
