"""The recorder keeps what it hears, survives lost increments, a restart and a full disk."""

from __future__ import annotations

import errno
import json
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.bus import LocalBus, LocalMesh
from common.errors import ErrorCode
from common.messages.mapping import MapUpdate, PoseEstimate, Trajectory
from common.messages.mission import Outcome, PlannerView
from common.messages.points_of_interest import DoorStatement, PointOfInterest
from common.messages.topics import DOOR, DOOR_NOTES, MAP, PLAN, POI, POSE, STATUS, TRAJECTORY, ZONES
from common.zones import Zone, ZoneKind, message_of
from offboard.recorder.recorder import WRITE_PERIOD_S, Recorder
from offboard.runs import run_folder
from offboard.runs.map_assembly import MapAssembly
from onboard.comm.outbox import Outbox


def pose(t_s: float, x_m: float = 0.0, heading_rad: float = 0.0) -> PoseEstimate:
    return PoseEstimate(t_s, x_m, 0.0, heading_rad, 0.0, 0.01, 0.01, 1)


def map_update(start: int, xs: list[float], revision: int = 1) -> MapUpdate:
    points = np.array([[x, 0.0] for x in xs], np.float32).reshape(-1, 2)
    return MapUpdate(0.0, revision, start, points, np.zeros(len(xs), np.uint8))


def door(poi_id: int, number: str, photo: bytes = b"") -> PointOfInterest:
    return PointOfInterest(1.0, poi_id, "Door", number, 1.0, 2.0, number, "Office", 0.9, "read", photo)


def view(*, finished: bool) -> PlannerView:
    outcome = Outcome.FINISHED if finished else Outcome.NONE
    return PlannerView(0.0, "explore", "", np.empty((0, 2), np.float32), 0, 0.0, outcome)


# The second and third hold what is not yet in the first, while it is open
DATABASE = {"run.sqlite", "run.sqlite-wal", "run.sqlite-shm"}


class Run:
    """A recorder and someone who talks to it."""

    def __init__(self, folder: Path, seed: int = 1) -> None:
        """Another seed: a robot that has been started again."""
        self.mesh = LocalMesh(seed)
        self.robot, self.bus = self.mesh.endpoint("robot"), self.mesh.endpoint("recorder")
        self.comm = self.mesh.endpoint("comm")
        self.outbox = Outbox(None, 1_000_000_000, new_id=seed)
        self.folder = folder
        self.recorder = Recorder(folder)
        self.step()

    def say(self, topic: Any, *messages: Any) -> None:
        for message in messages:
            self.robot.publish(topic, message)
        self.step()

    def step(self, passed_s: float = 1.0) -> None:
        """Long enough that what was said is on the disk."""
        end_s = self.mesh.now_s + passed_s
        while self.mesh.now_s < end_s:
            self.mesh.now_s = round(self.mesh.now_s + 0.05, 6)
            self.outbox.step(self.comm, self.mesh.now_s)
            self.recorder.step(self.bus, self.mesh.now_s)

    @property
    def error(self) -> int | None:
        status = self.robot.latest(STATUS["recorder"])
        return status.error_code if status else None


@pytest.fixture
def run(tmp_path: Path) -> Iterator[Run]:
    made = Run(tmp_path / "run")
    yield made
    made.recorder._draw = lambda _: None  # nobody looks at its pictures any more
    made.recorder.close()


def xs_of_map(folder: Path) -> list[float]:
    return [round(float(x), 3) for x in run_folder.read_map_points(folder / "map_points.csv")[0][:, 0]]


def test_poses_are_on_the_disk_soon(run: Run) -> None:
    run.say(POSE, pose(1.0, 0.5, np.pi / 2), pose(1.1, 0.6))
    lines = (run.folder / "trajectory.tum").read_text().splitlines()
    assert lines[0] == "1.0000 0.5000 0.0000 0 0 0 0.7071068 0.7071068"
    assert len(lines) == 2


def test_poses_that_come_late_are_left_out(run: Run) -> None:
    run.say(POSE, pose(1.0), pose(1.0), pose(0.9), pose(1.2))
    assert run_folder.read_tum(run.folder / "trajectory.tum")[0].tolist() == [1.0, 1.2]


def test_everything_else_is_written_every_ten_seconds(run: Run) -> None:
    run.say(MAP, map_update(0, [1.0, 2.0]))
    assert not (run.folder / "map_points.csv").exists()
    run.step(WRITE_PERIOD_S)
    assert (run.folder / "map_points.csv").read_text() == "x_m,y_m,inferred\n1.000,0.000,0\n2.000,0.000,0\n"
    assert json.loads((run.folder / "pois.json").read_text()) == []


def test_map_increments_append_and_a_new_beginning_replaces_all(run: Run) -> None:
    run.say(MAP, map_update(0, [1.0, 2.0]), map_update(2, [3.0]))
    run.step(WRITE_PERIOD_S)
    assert xs_of_map(run.folder) == [1.0, 2.0, 3.0]
    run.say(MAP, map_update(0, [7.0], revision=2))
    run.recorder.close()
    assert xs_of_map(run.folder) == [7.0]


def test_what_a_person_drew_is_in_the_run_folder_also_after_a_restart(run: Run) -> None:
    line = Zone(1, ZoneKind.LINE, ((3.0, -1.0), (3.0, 1.0)))
    run.say(MAP, map_update(0, [1.0]))
    run.step(WRITE_PERIOD_S)
    assert run_folder.read_map(run.folder).zones == ()
    run.say(ZONES, message_of(1.0, (line,)))
    run.recorder.close()
    assert run_folder.read_map(run.folder).zones == (line,)
    run.recorder = Recorder(run.folder)
    run.say(MAP, map_update(1, [2.0]))
    run.step(WRITE_PERIOD_S)
    assert run_folder.read_map(run.folder).zones == (line,)


def of_door(poi_id: int, number: str, room_name: str, command_id: int = 5) -> DoorStatement:
    return DoorStatement(2.0, poi_id, 1.0, 2.0, number, room_name, command_id=command_id)


def test_what_a_person_said_of_a_door_stands_beside_what_was_read_and_outlives_a_restart(run: Run) -> None:
    run.say(POI, door(1, "214"))
    person = run.mesh.endpoint("command_center")
    assert person.latest(DOOR_NOTES) is None
    person.publish(DOOR, of_door(1, "241", "Kitchen"))
    run.step()
    answer = person.latest(DOOR_NOTES)
    assert answer is not None
    assert (answer.command_id, answer.numbers) == (5, ("241",)), "it is answered once it is stored"
    run.recorder.close()

    def record() -> dict[str, Any]:
        (found,) = run_folder.read_pois(run.folder / "pois.json")
        return found

    expected = {"number": "241", "number_read": "214", "key": "241", "room_name": "Kitchen", "judged": "corrected"}
    assert record().items() >= expected.items()
    run.recorder = Recorder(run.folder)
    run.say(POI, door(1, "215"))
    run.step(WRITE_PERIOD_S)
    assert record().items() >= (expected | {"number_read": "215"}).items(), "a newer reading does not override it"
    again = person.latest(DOOR_NOTES)
    assert again is not None
    assert again.numbers == ("241",)

    person.publish(DOOR, of_door(1, "", "", command_id=6))
    run.step(1.0 + WRITE_PERIOD_S)
    assert record()["number"] == "215"
    assert "judged" not in record()


def test_lost_map_points_are_noticed_until_the_map_begins_anew(run: Run, caplog: pytest.LogCaptureFixture) -> None:
    run.say(MAP, map_update(0, [1.0]), map_update(4, [5.0]))
    assert "points were lost" in caplog.text
    assert "3 map points" in run.robot.latest(STATUS["recorder"]).detail  # type: ignore[union-attr]
    run.step(WRITE_PERIOD_S)
    assert xs_of_map(run.folder) == [1.0, 5.0]
    run.say(MAP, map_update(0, [1.0, 2.0, 3.0, 4.0, 5.0], revision=2))
    run.step()
    assert run.robot.latest(STATUS["recorder"]).detail == ""  # type: ignore[union-attr]


def test_increment_of_a_revision_whose_beginning_was_lost_is_noticed() -> None:
    assembly = MapAssembly()
    assembly.add(map_update(0, [1.0, 2.0], revision=1))
    assert assembly.add(map_update(2, [3.0], revision=2)) == 2
    assert assembly.missing == 2
    assert len(assembly.known()[0]) == 3


@given(st.lists(st.integers(0, 6), max_size=12))
def test_map_arrives_whole_however_it_is_cut(sizes: list[int]) -> None:
    assembly, start = MapAssembly(), 0
    for size in sizes:
        assert assembly.add(map_update(start, [float(start + k) for k in range(size)])) == 0
        start += size
    assert assembly.known()[0][:, 0].tolist() == list(range(start))
    assert assembly.missing == 0


def test_point_of_interest_keeps_its_photo_when_its_record_is_refined(run: Run) -> None:
    run.say(POI, door(4, "", b"jpeg"), door(5, "12"))
    run.say(POI, door(4, "101A"))
    run.recorder.close()
    records = json.loads((run.folder / "pois.json").read_text())
    assert [(r["poi_id"], r["number"], r["photo"]) for r in records] == [(4, "101A", "photos/poi_4.jpg"), (5, "12", "")]
    assert [r["key"] for r in records] == ["101A", "12"]
    assert (run.folder / "photos" / "poi_4.jpg").read_bytes() == b"jpeg"


def test_newest_smoothed_trajectory_is_the_one_that_stays(run: Run) -> None:
    for x_m in (1.0, 2.0):
        run.say(TRAJECTORY, Trajectory(0.0, np.array([0.0, 1.0]), np.array([[0.0, 0.0, 0.0], [x_m, 0.0, 0.1]])))
    run.recorder.close()
    times_s, poses = run_folder.read_tum(run.folder / "trajectory_smoothed.tum")
    assert times_s.tolist() == [0.0, 1.0]
    np.testing.assert_allclose(poses[1], [2.0, 0.0, 0.1], atol=1e-6)


@pytest.mark.requirement("VSL_MR_04")
def test_finished_mission_leaves_a_complete_folder_at_once(run: Run) -> None:
    run.say(POSE, pose(1.0), pose(2.0, 3.0))
    run.say(MAP, map_update(0, [1.0, 1.1]))
    run.say(PLAN, view(finished=False))
    assert not (run.folder / "map.svg").exists()
    run.say(PLAN, view(finished=True))
    files = {path.name for path in run.folder.iterdir()}
    assert files == {"trajectory.tum", "map_points.csv", "pois.json", "map.svg", "map.png"} | DATABASE
    assert run.recorder.finished


def test_restarted_recorder_continues_the_folder(run: Run) -> None:
    run.say(POSE, pose(1.0))
    run.say(POI, door(1, "7"))
    run.recorder.close()
    with (run.folder / "trajectory.tum").open("a") as file:
        file.write("1.5 0.3 half a li")
    again = Run(run.folder, seed=2)
    again.say(POSE, pose(2.0))
    again.say(POI, door(2, "8"))
    again.recorder.close()
    assert run_folder.read_tum(run.folder / "trajectory.tum")[0].tolist() == [1.0, 2.0]
    assert [record["number"] for record in run_folder.read_pois(run.folder / "pois.json")] == ["7", "8"]


def test_full_disk_is_one_warning_and_loses_nothing(
    run: Run, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    run.say(POSE, pose(1.0))
    with monkeypatch.context() as full, caplog.at_level(logging.ERROR):
        full.setattr(run_folder.LineFile, "append", refuse)
        full.setattr(run_folder, "write_atomically", refuse)
        for k in range(30):
            run.say(POSE, pose(2.0 + k))
            run.step(WRITE_PERIOD_S / 2)
        assert run.error == ErrorCode.DISK_FULL
    assert [record.getMessage() for record in caplog.records if record.name == "recorder"] == [
        f"cannot write the run (No space left on device): free space on the disk of {run.folder}"
    ]
    run.step(WRITE_PERIOD_S)
    run.step()
    assert run.error == ErrorCode.OK
    assert len(run_folder.read_tum(run.folder / "trajectory.tum")[0]) == 31


def test_folder_that_cannot_be_made_is_a_warning_and_no_crash(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    run = Run(tmp_path / "file" / "run")
    run.say(POSE, pose(1.0))
    run.recorder.close()
    assert run.error == ErrorCode.DISK_REFUSES


def test_line_that_the_disk_took_in_part_is_taken_back(tmp_path: Path) -> None:
    class HalfFile:
        def __init__(self, inner: Any) -> None:
            self._inner = inner

        def write(self, data: bytes) -> int:
            return int(self._inner.write(data[: len(data) // 2]))

        def __getattr__(self, name: str) -> Any:
            return getattr(self._inner, name)

    lines = run_folder.LineFile(tmp_path / "lines")
    lines.append(["one"])
    whole, lines._file = lines._file, HalfFile(lines._file)  # type: ignore[assignment]
    with pytest.raises(OSError, match="part"):
        lines.append(["two"])
    lines._file = whole
    lines.append(["three"])
    lines.close()
    assert (tmp_path / "lines").read_text() == "one\nthree\n"


def test_file_that_cannot_be_replaced_stays_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "pois.json"
    run_folder.write_json(target, [1])

    def refuse(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.fsync", refuse)
    with pytest.raises(OSError, match="No space"):
        run_folder.write_json(target, [2])
    assert json.loads(target.read_text()) == [1]
    assert [path.name for path in tmp_path.iterdir()] == ["pois.json"]


def test_same_messages_leave_the_same_bytes(tmp_path: Path) -> None:
    folders = [Run(tmp_path / name) for name in ("a", "b")]
    for run in folders:
        run.say(POSE, pose(1.0), pose(2.0, 1.0))
        run.say(MAP, map_update(0, [0.0, 0.1, 0.2]))
        run.say(POI, door(1, "7", b"x"))
        run.recorder.close()
    for path in folders[0].folder.rglob("*.*"):
        assert path.read_bytes() == (folders[1].folder / path.relative_to(folders[0].folder)).read_bytes(), path.name


def test_recorder_says_that_it_is_ready(run: Run) -> None:
    status = run.robot.latest(STATUS["recorder"])
    assert isinstance(run.bus, LocalBus)
    assert status is not None
    assert status.ready
