"""Power cuts of robot and laptop at any moment: what their disks had taken, and what came after, is in the database."""

from __future__ import annotations

import random
import shutil
import sqlite3
from collections.abc import Iterable, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import msgpack
import pytest

from common import recording
from common.bus import LocalBus, LocalMesh
from common.messages.health import Status
from common.messages.mapping import PoseEstimate
from common.messages.points_of_interest import PointOfInterest
from common.messages.topics import OUTBOX, POI, POSE, RECEIPT, STATUS, Topic
from common.recording import Losses, RecentMessages, RecordedMessage, RecordingSubscriber, queried_after
from offboard.recorder.recorder import Recorder
from offboard.runs.run_database import RunReader
from onboard.comm.outbox import Outbox

Message = tuple[str, int, int]  # topic, boot id, sequence number
STEP_S = 0.05
SAID = (POSE, STATUS["mmu"], POI, STATUS["poi"])
RECENT_COUNT = 60  # of each topic: a cut may cost some of a sender that survives it too


class Senders:
    """What each living sender still has of what it said, and everything that was ever said."""

    def __init__(self, mesh: LocalMesh) -> None:
        self.said: set[Message] = set()
        self._recent: dict[tuple[str, int], RecentMessages] = {}
        self._ear = mesh.endpoint("ear")
        self._ear.record(SAID, {})

    def listen(self) -> None:
        for message in self._ear.take_recorded():
            self.said.add((message.key, message.boot_id, message.sequence))
            recent = self._recent.setdefault((message.key, message.boot_id), RecentMessages())
            recent.append(message.sequence, message.data)

    def die(self, keys: Iterable[str]) -> None:
        self._recent = {source: recent for source, recent in self._recent.items() if source[0] not in keys}

    def answers(self, key: str, query: bytes) -> list[bytes]:
        asked_for = [(boot_id, recent) for (topic, boot_id), recent in self._recent.items() if topic == key]
        return [msgpack.packb(recent.after(queried_after(query, boot_id))) for boot_id, recent in asked_for]

    def kept(self) -> set[Message]:
        """All but the oldest, which makes way for the next message before anybody can ask."""
        numbers = {source: [number for number, _ in recent._messages] for source, recent in self._recent.items()}
        return {(*source, number) for source, kept in numbers.items() for number in kept[-RECENT_COUNT + 1 :]}


class TappedBus(LocalBus):
    """comm's end, where what is missing is asked for as between processes."""

    def __init__(self, mesh: LocalMesh, senders: Senders) -> None:
        super().__init__(mesh, "comm", 1)
        mesh._endpoints.append(self)
        self._clock, self._senders = mesh, senders
        self._order: RecordingSubscriber | None = None

    def record(self, topics: Iterable[Topic[object]], known: Mapping[tuple[str, int], int]) -> None:
        super().record(topics, known)
        self._order = RecordingSubscriber(
            sorted(self.recorded_keys), self.recorded_keys, known, self._query, lambda: self._clock.now_s
        )

    def take_recorded(self) -> list[RecordedMessage]:
        if self._order is None:
            return []
        for message in super().take_recorded():
            self._order.store(message.key, message.data)
        return self._order.messages()

    def take_lost(self) -> Losses:
        return self._order.take_lost() if self._order is not None else {}

    def _query(self, key: str, query: bytes) -> None:
        assert self._order is not None
        for pack in self._senders.answers(key, query):
            self._order.add_reply(key, pack)


class World:
    """A robot whose power takes "mmu" and comm with it, but not "poi", and a laptop that may lose its own."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.chance = random.Random(seed)
        self.mesh, self.far_mesh = LocalMesh(1), LocalMesh(2)
        self.senders = Senders(self.mesh)
        self.poi = self.mesh.endpoint("poi")
        self.near, self.far = self.mesh.endpoint("link"), self.far_mesh.endpoint("link")
        self.near.take(OUTBOX)
        self.far.take(RECEIPT)
        self.connected = True
        self.gone: set[Message] = set()  # no disk had taken it, and nobody remembers it
        self._folder, self._lives, self._steps = folder, 0, 0
        self.robot_dir = self.run_dir = folder / "0"
        self.robot_dir.mkdir()
        self.start_robot()
        self.start_laptop()

    def start_robot(self) -> None:
        self._lives += 1
        self.mmu = self.mesh.endpoint(f"mmu {self._lives}")
        self.comm = TappedBus(self.mesh, self.senders)
        self.outbox = Outbox(self.robot_dir / "outbox.sqlite", 10_000_000, new_id=100 + self._lives)
        self.never_sync(self.outbox._store._database)

    def start_laptop(self) -> None:
        self.laptop = self.far_mesh.endpoint("recorder")
        self.recorder = Recorder(self.run_dir)
        self.recorder.step(self.laptop, self.far_mesh.now_s)
        self.never_sync(self.recorder._run.database.connection)  # type: ignore[union-attr]

    @staticmethod
    def never_sync(database: sqlite3.Connection | None) -> None:
        """The worst disk: a checkpoint waits for the medium, so that from then on no cut could take what is before."""
        assert database is not None
        database.execute("PRAGMA wal_autocheckpoint = 0")

    def run(self, steps: int, *, talk: bool = True) -> None:
        for _ in range(steps):
            self._steps += 1
            self.mesh.now_s = self.far_mesh.now_s = self._steps * STEP_S
            if talk:
                self.talk()
            self.senders.listen()
            self.outbox.step(self.comm, self.mesh.now_s)
            pieces = self.near.take(OUTBOX)
            receipts = self.far.take(RECEIPT)
            if self.connected:
                for piece in pieces:
                    self.far.publish(OUTBOX, piece)
                for receipt in receipts:
                    self.near.publish(RECEIPT, receipt)
            self.recorder.step(self.laptop, self.far_mesh.now_s)

    def talk(self) -> None:
        now_s, k = self.mesh.now_s, self._steps
        self.mmu.publish(POSE, PoseEstimate(now_s, float(k), 0.0, 0.0, 0.0, 0.1, 0.1, 1))
        for name, module in (("mmu", self.mmu), ("poi", self.poi)):
            module.publish(STATUS[name], Status(now_s, "RUN", 0, 0, True, k))
        if k % 20 == 0:
            door = PointOfInterest(now_s, k, "Door", "", 1.0, 2.0, "", "", 0.9, "read", bytes(100_000))
            self.poi.publish(POI, door)

    def cut(self, *, robot: bool, laptop: bool, laptop_lies: bool = False) -> None:
        """Whatever runs there ends without a word; its disk is as it was, or as the medium had taken it."""
        self._lives += 1
        stored = in_database(self.run_dir)
        folder = self._folder / str(self._lives)
        folder.mkdir()
        if robot:
            self._restore(self.robot_dir / "outbox.sqlite", folder, unsynced=True)
            self.outbox._store.close()
            self.mesh._endpoints.remove(self.comm)
            self.senders.die({POSE.key, STATUS["mmu"].key})
            self.robot_dir = folder
        if laptop:
            self._restore(self.run_dir / "run.sqlite", folder, unsynced=laptop_lies)
            shutil.copy(self.run_dir / "trajectory.tum", folder)
            self.recorder._run.database.close()  # type: ignore[union-attr]
            self.far_mesh._endpoints.remove(self.laptop)
            self.run_dir = folder
        # What any disk holds now, or somebody who lives on remembers, must not get lost any more
        in_memory = {(message.key, message.boot_id, message.sequence) for message in self.outbox._waiting}
        kept = in_outbox(self.robot_dir) | (self.senders.kept() if robot else in_memory)
        # But what a laptop had acknowledged, nobody else need have
        kept = (kept - stored) | in_database(self.run_dir)
        self.gone |= self.senders.said - kept
        if robot:
            self.start_robot()
        if laptop:
            self.start_laptop()

    def _restore(self, file: Path, folder: Path, *, unsynced: bool) -> None:
        shutil.copy(file, folder)
        wal = file.with_name(f"{file.name}-wal").read_bytes()
        # A commit that the medium did not take is cut off, and all after it: the frames of a WAL are a chain
        taken = self.chance.randint(0, len(wal)) if unsynced else len(wal)
        (folder / f"{file.name}-wal").write_bytes(wal[:taken])


def in_outbox(folder: Path) -> set[Message]:
    rows = [msgpack.unpackb(data)[0] for (data,) in everything(folder / "outbox.sqlite", "data", "rows")]
    return {(key, boot_id, sequence) for row in rows for key, boot_id, sequence, _ in row}


def in_database(folder: Path) -> set[Message]:
    return set(everything(folder / "run.sqlite", "topic, boot_id, sequence", "messages"))


def everything(file: Path, columns: str, table: str) -> list[tuple[Any, ...]]:
    """Nothing of a file whose medium had not even taken its tables."""
    with closing(sqlite3.connect(file)) as database:
        there = database.execute("SELECT count(*) FROM sqlite_master WHERE name = ?", (table,)).fetchone() == (1,)
        return database.execute(f"SELECT {columns} FROM {table}").fetchall() if there else []


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> World:
    monkeypatch.setattr(recording, "RECENT_COUNT", RECENT_COUNT)
    return World(tmp_path, request.param)


@pytest.mark.requirement("CM_MR_01")
@pytest.mark.parametrize("world", [1, 2], indirect=True)
def test_fifty_power_cuts_lose_only_what_no_disk_had_taken_and_the_database_counts_it(world: World) -> None:
    for _ in range(50):
        world.connected = world.chance.random() < 0.7
        world.run(world.chance.randint(1, 60))
        which = world.chance.choice(("robot", "laptop", "both", "laptop whose disk lies"))
        world.cut(
            robot=which in ("robot", "both"), laptop=which != "robot", laptop_lies=which == "laptop whose disk lies"
        )
    world.connected = True
    world.run(40)
    world.run(400, talk=False)
    there = in_database(world.run_dir)
    assert world.outbox.stored_bytes == 0
    assert world.senders.said - there - world.gone == set()
    with RunReader(world.run_dir) as run:
        dropped = run.dropped()
    numbers: dict[tuple[str, int], set[int]] = {}
    for key, boot_id, sequence in there:
        numbers.setdefault((key, boot_id), set()).add(sequence)
    # Beyond the newest that anybody knows of, nobody can count
    holes = {source: max(found) - min(found) + 1 - len(found) for source, found in numbers.items()}
    assert {source: count for source, count in holes.items() if count > dropped.get(source, 0)} == {}
    for source, count in dropped.items():
        said = {sequence for key, boot_id, sequence in world.senders.said if (key, boot_id) == source}
        assert count <= len(said - numbers.get(source, set())), source
    assert sum(holes.values()) > 0
