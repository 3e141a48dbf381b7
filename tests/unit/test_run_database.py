"""The run database as others read it: messages, newest, logs, status, points of interest; and what is no message."""

from __future__ import annotations

import random
import sqlite3
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.codec import CODEC_VERSION, DecodeError, decode, encode, read_header
from common.messages.health import LogLine, Status
from common.messages.mapping import PoseEstimate
from common.messages.points_of_interest import PointOfInterest
from common.messages.topics import LOG, PLAN, POI, POSE, STATUS, TOPICS
from common.recording import RecordedMessage
from deploy.cli import main
from offboard.runs.run_database import RunReader
from offboard.runs.run_schema import SCHEMA_VERSION, Delivery, RunDatabase, RunDatabaseError
from tests.fuzz.wild import fit
from tests.unit.damage import spoil_schema


def pose(t_s: float) -> PoseEstimate:
    return PoseEstimate(t_s, t_s, 0.0, 0.0, 0.0, 0.01, 0.01, 1)


def message(topic: Any, sequence: int, payload: Any, boot_id: int = 1) -> RecordedMessage:
    return RecordedMessage(topic.key, boot_id, sequence, encode(payload, sequence, boot_id))


@pytest.fixture
def database(tmp_path: Path) -> RunDatabase:
    return RunDatabase(tmp_path / "run.sqlite", "2026-01-02T03:04:05+00:00", recorder_id=7)


def store(database: RunDatabase, *messages: RecordedMessage) -> int:
    return len(database.store_data(Delivery(1.0, list(messages))).stored)


def test_a_message_that_is_there_is_not_stored_again(database: RunDatabase, tmp_path: Path) -> None:
    first = message(POSE, 1, pose(1.0))
    assert store(database, first, first) == 1
    assert store(database, first, message(POSE, 1, pose(5.0), boot_id=2)) == 1
    with RunReader(tmp_path) as run:
        assert [m.payload.t_s for m in run.messages(POSE)] == [1.0, 5.0]
        assert run.senders() == {(POSE.key, 1): (1, 1), (POSE.key, 2): (1, 1)}


def test_messages_are_read_by_time_and_onwards_from_a_row(database: RunDatabase, tmp_path: Path) -> None:
    store(database, *(message(POSE, k, pose(float(k))) for k in range(1, 11)))
    with RunReader(tmp_path) as run:
        assert [m.sequence for m in run.messages(POSE, since_s=3.0, until_s=5.0)] == [3, 4, 5]
        seen = run.latest(POSE)
        assert seen is not None
        assert seen.sequence == 10
        assert list(run.display_data(after_row=seen.row)) == []
        store(database, message(POSE, 11, pose(11.0)))
        assert [m.as_text("comm") for m in run.display_data(seen.row)] == [
            "MMU_CM_11000_11.000,0.000,0.000,0.000,0.010,0.010,1,inf,0.000"
        ]
        assert run.latest(PLAN) is None


def test_log_lines_are_found_by_module_level_and_text(database: RunDatabase, tmp_path: Path) -> None:
    for k, (module, level, text) in enumerate(
        [("mmu", "INFO", "started"), ("mmu", "WARNING", "Late"), ("comm", "INFO", "late too"), ("mmu", "INFO", "x")], 1
    ):
        store(database, message(LOG[module], k, LogLine(float(k), level, text)))
    with RunReader(tmp_path) as run:
        assert [entry.line.text for entry in run.logs()] == ["started", "Late", "late too", "x"]
        assert [entry.line.text for entry in run.logs("mmu", limit=2)] == ["Late", "x"]
        assert [entry.module for entry in run.logs(containing="late")] == ["mmu", "comm"]
        assert [entry.line.text for entry in run.logs(levels=("WARNING",))] == ["Late"]


def test_status_history_can_be_read_by_its_changes(database: RunDatabase, tmp_path: Path) -> None:
    for k, state in enumerate(["RUN", "RUN", "LATE", "LATE", "RUN"], 1):
        store(database, message(STATUS["mmu"], k, Status(float(k), state, 0, 1, True, k)))
    with RunReader(tmp_path) as run:
        assert len(list(run.statuses("mmu"))) == 5
        assert [m.payload.t_s for m in run.statuses("mmu", changes_only=True)] == [1.0, 3.0, 5.0]


def test_points_of_interest_are_the_newest_with_their_photos(database: RunDatabase, tmp_path: Path) -> None:
    def door(poi_id: int, number: str, photo: bytes) -> PointOfInterest:
        return PointOfInterest(1.0, poi_id, "Door", number, 1.0, 2.0, number, "", 0.9, "read", photo)

    photo = bytes(range(256)) * 100
    for k, record in enumerate([door(1, "", photo), door(2, "7", b"p"), door(1, "12", b"")], 1):
        store(database, message(POI, k, record))
    with RunReader(tmp_path) as run:
        assert [(poi.poi_id, poi.number, poi.photo_jpeg) for poi in run.pois()] == [(1, "12", photo), (2, "7", b"p")]


def test_another_version_is_stored_and_named_but_not_given_as_a_message(database: RunDatabase, tmp_path: Path) -> None:
    later = msgpack.packb([CODEC_VERSION + 1, 1, 1, {}])
    result = database.store_data(
        Delivery(1.0, [RecordedMessage(POSE.key, 1, 1, later), RecordedMessage("mmu/unheard", 1, 1, later)])
    )
    assert "codec version" in result.problems[POSE.key]
    with RunReader(tmp_path) as run:
        assert list(run.messages(POSE)) == []
        assert run.problems() == {POSE.key: 1, "mmu/unheard": 1}


def test_what_is_no_run_database_is_said_in_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(RunDatabaseError, match="indoor-mapping runs"):
        RunReader(tmp_path)
    (tmp_path / "run.sqlite").write_bytes(b"no database" * 1000)
    with pytest.raises(RunDatabaseError, match="is no run database"):
        RunReader(tmp_path)
    (tmp_path / "run.sqlite").unlink()
    with sqlite3.connect(tmp_path / "run.sqlite") as newer:
        newer.execute("CREATE TABLE messages (x)")
        newer.execute(f"PRAGMA user_version = {SCHEMA_VERSION + 1}")
    with pytest.raises(RunDatabaseError, match="newer program"):
        RunReader(tmp_path)


def test_a_run_database_whose_schema_is_no_text_is_told_in_one_sentence(tmp_path: Path) -> None:
    RunDatabase(tmp_path / "run.sqlite", None, 1).close()
    spoil_schema(tmp_path / "run.sqlite")
    with pytest.raises(RunDatabaseError, match="malformed database schema"), RunReader(tmp_path) as run:
        run.dates()


EXAMPLES = {topic.key: encode(fit(topic.payload, random.Random(1)), 1, 1) for topic in TOPICS}
TOPIC_OF = {topic.key: topic for topic in TOPICS}


@given(st.sampled_from(sorted(EXAMPLES)), st.binary(max_size=200), st.randoms())
def test_damaged_messages_of_every_topic_are_refused_or_decoded_and_nothing_else(
    key: str, junk: bytes, chance: random.Random
) -> None:
    sound = EXAMPLES[key]
    decode(sound, TOPIC_OF[key].payload)
    place = chance.randrange(len(sound))
    for data in (junk, sound[:place], sound + junk, sound[:place] + junk, sound[:place] + junk + sound[place + 1 :]):
        for attempt in (lambda d: decode(d, TOPIC_OF[key].payload), read_header):
            with suppress(DecodeError):
                attempt(data)


def test_runs_and_export_show_a_run(database: RunDatabase, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["runs", str(tmp_path)]) == 0
    assert "2026-01-02 03:04" in capsys.readouterr().out
    assert main(["export", str(tmp_path), "--to", str(tmp_path / "out"), "--format", "gif"]) == 2
    assert "choose from" in capsys.readouterr().err
    (tmp_path / "map_points.csv").write_text("x_m,y_m,inferred\n2.0,0.5,0\n")
    (tmp_path / "trajectory.tum").write_text("0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n")
    assert main(["export", str(tmp_path), "--to", str(tmp_path / "out"), "--format", "pgm,csv"]) == 0
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"map.pgm", "map.yaml", "map_points.csv"}


def test_occupancy_image_has_its_origin_at_the_lower_left_and_unknown_stays_unknown(tmp_path: Path) -> None:
    (tmp_path / "map_points.csv").write_text("x_m,y_m,inferred\n2.0,0.5,0\n")
    (tmp_path / "trajectory.tum").write_text("0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n")
    assert main(["export", str(tmp_path), "--to", str(tmp_path / "out"), "--format", "pgm"]) == 0
    header, size, depth, cells = (tmp_path / "out" / "map.pgm").read_bytes().split(b"\n", 3)
    columns, rows = map(int, size.split())
    image = np.frombuffer(cells, np.uint8).reshape(rows, columns)
    yaml = dict(line.split(": ", 1) for line in (tmp_path / "out" / "map.yaml").read_text().splitlines())
    x0_m, y0_m = (float(v) for v in yaml["origin"].strip("[]").split(",")[:2])

    def at(x_m: float, y_m: float) -> int:
        return int(image[rows - 1 - int((y_m - y0_m) / 0.05), int((x_m - x0_m) / 0.05)])

    assert (header, depth) == (b"P5", b"255")
    assert (at(2.001, 0.501), at(0.0, 0.0), at(1.8, -0.7)) == (0, 254, 205)
    assert float(yaml["free_thresh"]) < (255 - 205) / 255
