"""The run database holds what was said, once and in order, whatever is killed or cut off meanwhile.

What was said is known from the producers themselves: each writes the boot id and the newest sequence number of its
topics into a file (`talker.py`), and a database is compared with that.
"""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from offboard.recorder.run_database import RunReader
from tests.system.conftest import Mesh, until

pytestmark = pytest.mark.timeout(120)
TALKER = Path(__file__).with_name("talker.py")
Said = dict[tuple[str, int], int]  # topic and boot id -> newest sequence number


class Recording:
    """comm, recorder and two modules that talk."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self.run_dir = mesh.folder / "run"
        for name in ("comm", "recorder", "mmu", "poi"):
            self.start(name)
        until(lambda: self.stored() > 100, 20.0, "the first messages in the database")

    def start(self, name: str) -> None:
        if name == "comm":
            self.mesh.start(name)
        elif name == "recorder":
            self.mesh.start(name, "-m", "offboard.recorder", extra=("--run-dir", str(self.run_dir)))
        else:
            self.mesh.start(name, str(TALKER), name)

    def kill(self, name: str, down_s: float = 0.5) -> None:
        process = self.mesh.processes[name]
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        if process.stderr is not None:
            process.stderr.close()
        time.sleep(down_s)  # what a restart takes: meanwhile the others talk
        self.start(name)

    def stored(self) -> int:
        try:
            with RunReader(self.run_dir) as run:
                return sum(run.counts().values())
        except (ValueError, sqlite3.Error):
            return 0

    def said(self) -> Said:
        """By the modules, up to their end."""
        said: Said = {}
        for name in ("mmu", "poi"):
            text = (self.mesh.folder / f"{name}.said").read_text(encoding="utf-8")
            said |= {(topic, boot_id): newest for topic, boot_id, newest in json.loads(text)}
        return said

    def silence(self) -> Said:
        """The modules end and tell what they said; waits until the database holds it."""
        for name in ("mmu", "poi"):
            self.mesh.processes[name].send_signal(signal.SIGTERM)
            assert self.mesh.processes[name].wait(10.0) == 0
        said = self.said()
        until(lambda: self.missing(said) == {}, 40.0, f"the rest in the database: {self.missing(said)}")
        return said

    def missing(self, said: Said) -> dict[tuple[str, int], int]:
        with RunReader(self.run_dir) as run:
            senders = run.senders()
        counts = {source: newest - senders.get(source, (0, 0))[1] for source, newest in said.items()}
        return {source: count for source, count in counts.items() if count}

    def assert_once_and_in_order(self, said: Said) -> None:
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


@pytest.fixture
def recording(mesh: Mesh) -> Iterator[Recording]:
    made = Recording(mesh)
    yield made
    if os.environ.get("KEEP"):
        subprocess.run(["cp", "-r", str(mesh.folder), os.environ["KEEP"]], check=False)


def more(recording: Recording, count: int) -> Callable[[], bool]:
    """So many more messages than now are in the database."""
    before = recording.stored()
    return lambda: recording.stored() > before + count


@pytest.mark.requirement("CM_MR_01")
def test_recorder_killed_three_times_leaves_no_hole_and_no_double(recording: Recording) -> None:
    for _ in range(3):
        recording.kill("recorder")
        until(more(recording, 50), 20.0, "messages in the database again")
    recording.assert_once_and_in_order(recording.silence())


@pytest.mark.requirement("CM_MR_01")
def test_comm_killed_five_times_leaves_no_hole_and_no_double(recording: Recording) -> None:
    for _ in range(5):
        recording.kill("comm", down_s=1.0)
        until(more(recording, 50), 20.0, "messages in the database again")
    recording.assert_once_and_in_order(recording.silence())


@pytest.mark.requirement("CM_MR_01")
def test_what_was_said_while_the_recorder_was_away_arrives_from_the_robots_disk(recording: Recording) -> None:
    recorder = recording.mesh.processes["recorder"]
    recorder.send_signal(signal.SIGTERM)
    assert recorder.wait(10.0) == 0
    said = {}
    for name in ("mmu", "poi"):
        recording.mesh.processes[name].send_signal(signal.SIGTERM)
        assert recording.mesh.processes[name].wait(10.0) == 0
    said = recording.said()
    # The robot restarts before the laptop is there again: nobody but the disk knows what was said
    time.sleep(0.5)
    recording.kill("comm", down_s=0.1)
    recording.start("recorder")
    until(lambda: recording.missing(said) == {}, 20.0, "the rest in the database")
    recording.assert_once_and_in_order(said)
