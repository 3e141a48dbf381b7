"""A storm of messages over one node, which stands in a process of its own: what it cost, and how it was weathered."""

from __future__ import annotations

import gc
import logging
import multiprocessing
import random
import sys
import time
import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from common.bus import LocalMesh
from common.codec import DecodeError, decode, encode
from common.messages.stop import Permit
from common.messages.topics import PERMIT, TOPICS, Topic
from offboard.runs.run_schema import TOPIC_OF_KEY
from tests.fuzz.nodes import BOOT_ID, CALM_PERIOD_S, Stage, calm, stage_of, through_outbox
from tests.fuzz.wild import fit, poisoned

MESSAGES_PER_STEP = 10
CALM_S = 20.0
STEPS_AT_ONCE = 50
LARGE_BYTES = 100_000  # of a message that waits for no others, lest they all count as the node's memory

Heard = list[tuple[str, bytes]]  # keys of topics, messages


@dataclass(frozen=True)
class Outcome:
    """Of one storm, the calm before it included; `grown_mb` above the peak of that calm."""

    messages: int
    refused: int
    longest_step_ms: float
    grown_mb: float
    motors_started: bool
    trouble: str  # a traceback, empty where there was none


def storm(name: str, count: int, seed: int, longest: int | None = None) -> Outcome:
    """`count` messages over all topics that the node reads: half of them poisoned, half sound up to their bounds.

    `longest`: rows of the longest arrays, otherwise what is set for this node.
    """
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe()
    process = context.Process(target=_node, args=(name, theirs), daemon=True)
    process.start()
    theirs.close()  # or a node that has ended would be sent to for ever
    period_s, keys, usual_longest, by_outbox = ours.recv()
    topics: tuple[Topic[Any], ...] = tuple(topic for topic in TOPICS if topic.key in keys)
    permit = name != "bridge"  # of all nodes it alone starts motors, and without a permit it must not
    batch: list[Heard] = []
    row = 0
    try:
        for heard in _weather(period_s, topics, count, random.Random(seed), permit, longest or usual_longest):
            row += 1
            batch.append(through_outbox(heard, row) if by_outbox else heard)
            large = any(len(data) > LARGE_BYTES for _, data in heard)
            if large or len(batch) == STEPS_AT_ONCE:
                ours.send(batch)
                batch = []
        for rest in (batch, None):
            ours.send(rest)
    except BrokenPipeError:
        pass  # the node has ended; it has said why
    outcome: Outcome = ours.recv()
    process.join()
    return outcome


def _weather(
    period_s: float, topics: tuple[Topic[Any], ...], count: int, chance: random.Random, permit: bool, longest: int
) -> Iterator[Heard]:
    """What comes before each step; without a `permit` nobody grants one. The first of each topic is of full length."""
    fresh = set(topics)
    sequences = dict.fromkeys((topic.key for topic in topics), 0)

    def stamp(topic: Topic[Any]) -> tuple[int, int]:
        sequences[topic.key] += 1
        return sequences[topic.key], BOOT_ID

    calm_due_s, step, thrown = 0.0, 0, 0
    while thrown < count:
        step += 1
        now_s = step * period_s
        heard: Heard = []
        if now_s >= calm_due_s:
            calm_due_s += CALM_PERIOD_S
            heard += [(t.key, encode(p, *stamp(t))) for t, p in calm(now_s, permit) if t in topics]
        if now_s > CALM_S:
            for topic in chance.choices(topics, k=MESSAGES_PER_STEP):
                stamped = stamp(topic)
                if topic in fresh:
                    fresh.remove(topic)
                    data = encode(fit(topic.payload, chance, longest, longest_share=1.0), *stamped)
                elif chance.random() < 0.5:
                    data = poisoned(topic.payload, chance, *stamped, longest)
                else:
                    data = encode(fit(topic.payload, chance, longest), *stamped)
                if permit or topic is not PERMIT or not _grants(data):
                    heard.append((topic.key, data))
                    thrown += 1
        chance.shuffle(heard)
        yield heard


def _grants(data: bytes) -> bool:
    try:
        return decode(data, Permit).payload.granted
    except DecodeError:
        return False


def _node(name: str, pipe: Connection) -> None:
    """The process of the node."""
    logging.disable(logging.CRITICAL)
    gc.freeze()  # what the tests' own process holds is none of the node's
    mesh = LocalMesh()
    stage = stage_of(name, mesh)
    pipe.send((stage.node.period_s, {topic.key for topic in stage.topics}, stage.longest, stage.by_outbox))
    run = _Run(stage, mesh)
    try:
        while (batch := pipe.recv()) is not None:
            for heard in batch:
                run.step(heard)
        stage.close()
        pipe.send(run.outcome(""))
    except Exception:
        pipe.send(run.outcome(traceback.format_exc()))
        pipe.close()


class _Run:
    def __init__(self, stage: Stage, mesh: LocalMesh) -> None:
        self._stage, self._mesh = stage, mesh
        self._steps, self._thrown = 0, 0
        self._longest_s = self._calm_mb = 0.0
        self._started = False

    def step(self, heard: Heard) -> None:
        stage = self._stage
        self._steps += 1
        now_s = self._mesh.now_s = self._steps * stage.node.period_s
        if now_s > CALM_S:
            self._calm_mb = self._calm_mb or _peak_mb()
        self._thrown += len(heard)
        for key, data in heard:
            stage.bus.receive(TOPIC_OF_KEY[key], data)
        began_s = time.thread_time()
        stage.node.step(stage.bus, now_s)
        self._longest_s = max(self._longest_s, time.thread_time() - began_s)
        stage.beside(now_s)
        self._started = self._started or stage.motors()

    def outcome(self, trouble: str) -> Outcome:
        refused = sum(self._stage.bus.reader.undecodable.counts.values())
        grown_mb = _peak_mb() - self._calm_mb
        return Outcome(
            self._thrown, refused, round(1000 * self._longest_s, 1), round(grown_mb, 1), self._started, trouble
        )


def _peak_mb() -> float:
    """Most memory that this process ever held."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return int(status.partition("VmHWM:")[2].split()[0]) / 1024


if __name__ == "__main__":
    outcome = storm(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
    print(sys.argv[1], outcome.trouble or outcome)
