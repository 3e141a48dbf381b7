"""The recorder of a run in lockstep, in a process of its own (`awaited_work`): it decodes and stores what the robot
publishes while the robot goes on.

What it publishes reaches the mesh after a fixed simulated time, which stands for the Wi-Fi and the laptop's disk.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from functools import partial
from math import inf
from pathlib import Path
from typing import Any

from common.bus import Bus, LocalBus, LocalMesh, P
from common.messages.delivery import OutboxPiece
from common.messages.topics import LAPTOP_RECORDED, OUTBOX, Topic
from common.recording import RecordedMessage
from common.side_work import Work
from offboard.recorder.recorder import Recorder
from offboard.recorder.run_opening import OF_COMM
from offboard.runs.run_schema import TOPIC_OF_KEY
from offboard.simulator.run.awaited_work import AwaitedWorker
from offboard.simulator.stopwatch import Stopwatch

# Of a step's messages there and back. Less than the outbox waits before it sends again, with all steps on the way
_DELAY_STEPS = 5
_TOGETHER = 3  # steps whose messages go there together: each way costs more than what it carries
_LATENCY_S = (_DELAY_STEPS - _TOGETHER + 1) * Recorder.period_s - 0.01


@dataclass(frozen=True, slots=True)
class Arrivals:
    """What reached the recorder until a step; None for the step: it is to close the run."""

    now_s: float | None
    pieces: list[OutboxPiece] = field(default_factory=list)
    recorded: list[RecordedMessage] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Departures:
    """What the recorder published in that step: topic key, payload, whether it is news."""

    published: list[tuple[str, Any, bool]]
    finished: bool


class RecorderApart:
    """The node in the lockstep; the recorder itself is on the other side."""

    name = Recorder.name
    period_s = Recorder.period_s
    wakes_on = Recorder.wakes_on

    def __init__(self, run_dir: Path, stopwatch: Stopwatch) -> None:
        self.finished = False  # as `Recorder.finished`
        self._worker: AwaitedWorker[list[Arrivals], list[Departures]] = AwaitedWorker(
            stopwatch, _LATENCY_S, partial(_load, run_dir)
        )
        self._records = False
        self._there: list[Arrivals] = []
        self._back: deque[Departures] = deque()

    def step(self, bus: Bus, now_s: float) -> None:
        if not self._records:
            self._records = True
            bus.record((*LAPTOP_RECORDED, *OF_COMM), {})
        self._there.append(Arrivals(now_s, bus.take(OUTBOX), bus.take_recorded()))
        if len(self._there) == _TOGETHER:
            self._send(now_s)
        self._receive(now_s)
        if self._back:
            departures = self._back.popleft()
            self.finished = departures.finished
            for key, payload, news in departures.published:
                bus.publish(TOPIC_OF_KEY[key], payload, news=news)

    def close(self) -> None:
        """The run is on the disk, pictures included."""
        self._there.append(Arrivals(None))
        self._send(0.0)
        while self._worker.busy:
            self._receive(inf)
        self._worker.close()

    def _send(self, now_s: float) -> None:
        self._worker.begin(self._there, now_s)
        self._there = []

    def _receive(self, now_s: float) -> None:
        outcome = self._worker.result(now_s)
        if outcome is not None and outcome.value is not None:
            self._back += outcome.value


class _FarBus(LocalBus):
    """The recorder's bus; what it publishes is kept for the way back."""

    def __init__(self, mesh: LocalMesh, name: str, boot_id: int) -> None:
        super().__init__(mesh, name, boot_id)
        self.published: list[tuple[str, Any, bool]] = []

    def publish(self, topic: Topic[P], payload: P, *, news: bool = True) -> None:
        self.published.append((topic.key, payload, news))

    def arrive(self, arrivals: Arrivals) -> None:
        for piece in arrivals.pieces:
            self._receive(OUTBOX, piece, True)
        if self.recorded_keys:
            self.recorded += arrivals.recorded


def _load(run_dir: Path) -> Work[list[Arrivals], list[Departures]]:
    """What the process does with what arrives."""
    mesh = LocalMesh(bus=_FarBus)
    bus, recorder = mesh.endpoint(Recorder.name), Recorder(run_dir)
    assert isinstance(bus, _FarBus)

    def step(arrivals: Arrivals) -> Departures:
        if arrivals.now_s is None:
            recorder.close()
        else:
            mesh.now_s = arrivals.now_s
            bus.arrive(arrivals)
            recorder.step(bus, arrivals.now_s)
        published, bus.published = bus.published, []
        return Departures(published, recorder.finished)

    return lambda steps: [step(arrivals) for arrivals in steps]
