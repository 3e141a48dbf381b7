"""comm, recorder and two modules that talk: what they said, and what of it is in the run database.

What was said is known from the producers themselves: each writes the boot id and the newest sequence number of its
topics into a file (`talker.py`), and a database is compared with that.
"""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from common.bus import Bus
from common.config_file import config_text
from common.messages.mapping import MapUpdate
from common.messages.topics import MAP, ROBOT_RECORDED
from offboard.runs.map_assembly import MapAssembly
from offboard.runs.run_database import RunReader
from offboard.runs.run_schema import RunDatabaseError
from tests.system.conftest import Mesh, until

TALKER = Path(__file__).with_name("talker.py")
RECORDED = frozenset(topic.key for topic in ROBOT_RECORDED)
Said = dict[tuple[str, int], int]  # topic and boot id -> newest sequence number
Points = npt.NDArray[np.float32]  # (N, 2)


def assembled(updates: Iterable[MapUpdate]) -> Points:
    """The wall points that these increments make."""
    whole = MapAssembly()
    for update in updates:
        whole.add(update)
    return whole.known()[0]


class RobotMap:
    """The map as the mapping unit tells it on the robot."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._map = MapAssembly()
        self.points()

    def points(self) -> Points:
        for update in self._bus.take(MAP):
            self._map.add(update)
        return self._map.known()[0]


def recorded_map(run_dir: Path) -> Points:
    """The map as the run database holds it."""
    with RunReader(run_dir) as run:
        return assembled(message.payload for message in run.messages(MAP))


class Recording:
    """`robot`: where the recorder finds the robot, when that is not comm's own address.

    `inside`: words before the recorder's command, to run it on the far side of a link; `extra`: arguments of all.
    """

    def __init__(
        self,
        mesh: Mesh,
        run_dir: Path | None = None,
        robot: str | None = None,
        inside: tuple[str, ...] = (),
        extra: tuple[str, ...] = (),
    ) -> None:
        self.mesh = mesh
        self.run_dir = run_dir or mesh.folder / "run"
        self.laptop_config = mesh.folder / "laptop.toml"
        self._inside, self._extra = inside, extra
        config = replace(mesh.config, mesh=replace(mesh.config.mesh, router=robot or mesh.config.mesh.router))
        self.laptop_config.write_text(config_text(config), encoding="utf-8")
        for name in ("comm", "recorder", "mmu", "poi"):
            self.start(name)
        until(lambda: self.stored() > 100, 20.0, "the first messages in the database")

    def start(self, name: str) -> None:
        if name == "comm":
            self.mesh.start(name, extra=self._extra)
        elif name == "recorder":
            extra = ("--run-dir", str(self.run_dir), "--config", str(self.laptop_config), *self._extra)
            self.mesh.start(name, "-m", "offboard.recorder", extra=extra, inside=self._inside)
        else:
            self.mesh.start(name, str(TALKER), name, extra=self._extra)

    def kill(self, name: str, down_s: float = 0.5) -> None:
        self.end(name)
        time.sleep(down_s)  # what a restart takes: meanwhile the others talk
        self.start(name)

    def end(self, name: str) -> None:
        """As by a power cut."""
        process = self.mesh.processes[name]
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        if process.stderr is not None:
            process.stderr.close()

    def stored(self) -> int:
        try:
            with RunReader(self.run_dir) as run:
                return sum(run.counts().values())
        except RunDatabaseError:
            return 0

    def more(self, count: int) -> Callable[[], bool]:
        """So many more messages than now are in the database."""
        before = self.stored()
        return lambda: self.stored() > before + count

    def said(self) -> Said:
        """By the modules, up to their end."""
        said: Said = {}
        for name in ("mmu", "poi"):
            text = (self.mesh.folder / f"{name}.said").read_text(encoding="utf-8")
            said |= {(topic, boot_id): newest for topic, boot_id, newest in json.loads(text) if topic in RECORDED}
        return said

    def silence(self, deadline_s: float = 40.0) -> Said:
        """The modules end and tell what they said; waits until the database holds it."""
        for name in ("mmu", "poi"):
            self.mesh.processes[name].send_signal(signal.SIGTERM)
            assert self.mesh.processes[name].wait(10.0) == 0
        said = self.said()
        until(lambda: self.missing(said) == {}, deadline_s, "the rest in the database")
        return said

    def missing(self, said: Said) -> dict[tuple[str, int], int]:
        with RunReader(self.run_dir) as run:
            senders = run.senders()
        counts = {source: newest - senders.get(source, (0, 0))[1] for source, newest in said.items()}
        return {source: count for source, count in counts.items() if count}

    def assert_once_and_in_order(self, said: Said) -> None:
        """And the map that the database makes is the one that was told."""
        with RunReader(self.run_dir) as run:
            senders, dropped = run.senders(), run.dropped()
            assert {source: senders[source] for source in said} == {s: (newest, newest) for s, newest in said.items()}
            assert dropped == {}
            assert run.problems() == {}
            # comm's own too: numbers without a hole, also of those that were killed
            holes = {source: found for source, found in senders.items() if found[0] != found[1]}
            assert holes == {}
        with sqlite3.connect(self.run_dir / "run.sqlite") as database:
            query = "SELECT topic, boot_id, sequence FROM messages ORDER BY row"
            newest: Said = {}
            for topic, boot_id, sequence in database.execute(query):
                assert sequence == newest.get((topic, boot_id), 0) + 1, (topic, boot_id)
                newest[topic, boot_id] = sequence
        robots_map = np.load(self.mesh.folder / "mmu.map.npy")
        assert np.array_equal(recorded_map(self.run_dir), robots_map)
