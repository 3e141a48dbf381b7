"""Damaged run folders, configurations, floors, events and photos: one sentence and exit code 2, never a traceback."""

from __future__ import annotations

import errno
import json
import os
import re
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
import pytest

from common.config import Config, config_text, load_config, parse_config
from common.errors import StartError, sentence
from common.messages import MAP, PLAN, POI, POSE, RANGES, STATUS, TRAJECTORY, Ranges, Status, Trajectory
from common.zenoh_session import main_way
from deploy.cli import main
from offboard.command_center.places import findings_of_run
from offboard.recorder import run_database
from offboard.recorder.run_folder import read_tum
from offboard.simulator.options import DEFAULT_FLOOR, RunOptions, floor_path, load_world
from offboard.tools.export_formats import EXPORTERS
from offboard.tools.summary import RunFacts, StepTimes, write_summary
from onboard.poi.door_detection import ColourBox
from onboard.poi.poi import sign_rules
from tests.unit.damage import Damage, remove
from tests.unit.test_poi_frames import chessboard_view, plate_picture
from tests.unit.test_recorder import Run, door, map_update, pose, view

T = TypeVar("T")
SLOWEST_S = 10.0  # of a case, on a machine that is busy with other things
EVENTS = {
    "people": [{"from_s": 20, "to_s": 60, "speed_m_s": 1.0, "radius_m": 0.25, "waypoints": [[6, 1], [9, 1]]}],
    "blocked": [{"from_s": 30, "to_s": 90, "line": [[9, 0], [9, 2]]}],
}


def record_run(folder: Path) -> None:
    """A short run as recorder and simulation leave it, with every file that a run can have."""
    run = Run(folder)
    for k in range(40):
        run.robot.publish(POSE, pose(0.1 * k, 0.02 * k))
        run.robot.publish(RANGES, Ranges(0.1 * k, (1.0, 2.0, float("nan"), 2.0, 1.0), (0.0,) * 5))
    run.robot.publish(STATUS["mmu"], Status(1.0, "running", 0, 1000, True, 1))
    run.robot.publish(TRAJECTORY, Trajectory(4.0, np.arange(3.0), np.zeros((3, 3))))
    run.say(MAP, map_update(0, [0.1 * k for k in range(60)]))
    run.say(POI, door(1, "101", b"jpeg"), door(2, "102"))
    run.say(PLAN, view(finished=True))
    run.recorder.close()
    facts = RunFacts("office", 1, 0, {}, True, "home", 4.0, 1.0, {"mmu": StepTimes.of([0.001])})
    write_summary(folder, facts)
    summary = json.loads((folder / "summary.json").read_text())
    figures = {"coverage": 0.9, "map_rmse_m": 0.05, "home_m": 0.1, "ate_fit_m": None}
    (folder / "summary.json").write_text(json.dumps(summary | figures))


@pytest.fixture(scope="module")
def sound_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sound") / "run"
    record_run(folder)
    return folder


class RunFolder:
    """A run folder that is spoilt and made sound again."""

    def __init__(self, folder: Path, sound_run: Path) -> None:
        self.folder = folder
        folder.mkdir(parents=True)
        self._sound = {file.name: file.read_bytes() for file in sound_run.iterdir() if file.is_file()}
        self._touched = set(self._sound)
        self.mend()

    def mend(self) -> None:
        for name in (*self._touched, "run.sqlite-wal", "run.sqlite-shm", "run.sqlite-journal"):
            remove(self.folder / name)
        for name in self._touched:
            (self.folder / name).write_bytes(self._sound[name])
        self._touched = set()

    def spoil(self, damage: Damage) -> None:
        self._touched = set(damage.chance.sample(list(self._sound), damage.chance.choice((1, 1, 2))))
        for name in self._touched:
            file = self.folder / name
            if damage.chance.random() < 0.1:
                damage.in_place_of(file)
            elif name == "run.sqlite":
                damage.sqlite(file)
            else:
                wrong = damage.json_of if name.endswith(".json") else damage.words_of
                plain = name.endswith((".json", ".tum", ".csv"))
                data = file.read_bytes()
                file.write_bytes(damage.text_of(data, wrong) if plain else damage.bytes_of(data))


def assert_told(code: int, said: str) -> None:
    """Done, or refused in one line that a terminal may show."""
    assert code in (0, 2)
    if code == 2:
        (line,) = said.splitlines()
        assert re.fullmatch(r"indoor-mapping: .+\.", line), line
        assert line.isprintable()


def slow(cases: int) -> Any:
    return pytest.param(cases, marks=[pytest.mark.slow, pytest.mark.timeout(6 * 3600)])


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("summary.json", b"", "summary.json is not JSON"),
        ("summary.json", b'{"floor": 3}', "summary.json: key 'floor' must be a text"),
        ("summary.json", b'{"floor": "a", "simulated_time_s": NaN}', "key 'simulated_time_s' must be a number"),
        ("run.sqlite", b"SQLite format 3\0" + b"\0" * 1000, "run.sqlite"),
        ("run.sqlite", b"no database" * 100, "run.sqlite is no run database"),
    ],
)
def test_runs_shows_the_others_beside_a_damaged_run(
    name: str, content: bytes, said: str, sound_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoilt, sound = (RunFolder(tmp_path / "runs" / folder, sound_run) for folder in ("spoilt", "sound"))
    (spoilt.folder / name).write_bytes(content)
    assert main(["runs", str(tmp_path / "runs")]) == 0
    lines = {Path(line.split("  ")[0]): line for line in capsys.readouterr().out.splitlines()}
    assert "finished" in lines[sound.folder]
    assert "DAMAGED" not in lines[sound.folder]
    assert said in lines[spoilt.folder].partition("DAMAGED: ")[2]


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("map_points.csv", b"", "map_points.csv line 1 must be the header"),
        ("map_points.csv", b"x_m,y_m,inferred\n1,2,0\n1,nan,0\n", "map_points.csv line 3 must hold the numbers"),
        ("map_points.csv", b"x_m,y_m,inferred\n\xff\n", "is not text: its byte 18"),
        ("trajectory_smoothed.tum", b"0 0 0\n", "trajectory_smoothed.tum line 1 must hold the numbers t x y z"),
        ("pois.json", b'[{"x_m": 1, "y_m": 2}, {"x_m": "1", "y_m": 2}]', "pois.json: key '[1].x_m' must be a number"),
        ("pois.json", b"{}", "pois.json must hold a list"),
        ("pois.json", b"[" * 100_000, "pois.json is not JSON"),
    ],
)
def test_export_names_the_file_and_the_place_that_is_damaged(
    name: str, content: bytes, said: str, sound_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = RunFolder(tmp_path / "run", sound_run)
    (run.folder / name).write_bytes(content)
    code = main(["export", str(run.folder), "--to", str(tmp_path / "out"), "--format", "svg"])
    error = capsys.readouterr().err
    assert_told(code, error)
    assert said in error


def test_export_of_a_run_whose_database_lost_a_table_or_is_locked_says_so(
    sound_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_database, "_BUSY_S", 0.05)
    run = RunFolder(tmp_path / "run", sound_run)
    to_pgm = ["export", str(run.folder), "--to", str(tmp_path / "out"), "--format", "pgm"]
    with sqlite3.connect(run.folder / "run.sqlite", isolation_level=None) as database:
        database.execute("PRAGMA journal_mode = DELETE")
        database.execute("BEGIN EXCLUSIVE")
        assert main(to_pgm) == 2
        assert "run.sqlite cannot be read: database is locked" in capsys.readouterr().err
        database.execute("ROLLBACK")
        database.execute("DROP TABLE messages")
    assert main(to_pgm) == 2
    assert "run.sqlite cannot be read: no such table: messages" in capsys.readouterr().err


def test_what_lies_on_no_floor_is_left_out_of_pictures_with_a_sentence(
    sound_run: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    run, out = RunFolder(tmp_path / "run", sound_run), tmp_path / "out"
    with (run.folder / "map_points.csv").open("a") as points:
        points.write("1e7,3.0,0\n")
    (run.folder / "pois.json").write_text('[{"x_m": 1e5, "y_m": -1e5, "number": "99"}]')
    assert main(["export", str(run.folder), "--to", str(out), "--format", "svg,png,pgm"]) == 0
    assert f"{run.folder / 'map_points.csv'}: 1 of 61 places lie more than 500 m from the start" in caplog.text
    assert f"{run.folder / 'pois.json'}: 1 of 1 places" in caplog.text
    assert max(file.stat().st_size for file in out.iterdir()) < 1_000_000


def test_a_pose_that_is_only_half_written_is_no_pose_yet(sound_run: Path, tmp_path: Path) -> None:
    run = RunFolder(tmp_path / "run", sound_run)
    poses = read_tum(run.folder / "trajectory.tum")[1]
    with (run.folder / "trajectory.tum").open("a") as file:
        file.write("4.1000 0.82")
    assert read_tum(run.folder / "trajectory.tum")[1].tolist() == poses.tolist()


def test_folder_that_nobody_may_look_into_is_named_among_the_runs(
    sound_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    locked, sound = (RunFolder(tmp_path / "runs" / folder, sound_run) for folder in ("locked", "sound"))
    real_stat = os.stat

    def stat(path: Any, **options: Any) -> os.stat_result:
        if Path(path).parent == locked.folder:
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return real_stat(path, **options)

    monkeypatch.setattr(os, "stat", stat)  # for an administrator no folder is locked
    assert main(["runs", str(tmp_path / "runs")]) == 0
    said = capsys.readouterr().out
    assert f"{sound.folder}  " in said
    assert f"DAMAGED: {locked.folder / 'summary.json'}" in said
    assert "Permission denied" in said


def test_photos_that_lead_in_circles_or_are_no_files_are_not_exported(sound_run: Path, tmp_path: Path) -> None:
    run, out = RunFolder(tmp_path / "run", sound_run), tmp_path / "out"
    photos = run.folder / "photos"
    photos.mkdir()
    (photos / "poi_1.jpg").write_bytes(b"jpeg")
    (photos / "circle").symlink_to(run.folder)
    (photos / "itself").symlink_to("itself")
    os.mkfifo(photos / "pipe.jpg")
    assert main(["export", str(run.folder), "--to", str(out), "--format", "json"]) == 0
    assert [file.name for file in (out / "photos").iterdir()] == ["poi_1.jpg"]


def test_names_that_no_terminal_may_obey_are_shown_without_it(
    sound_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = RunFolder(tmp_path / "runs" / os.fsdecode(b"r\xff\x1b[2J"), sound_run)
    summary = json.loads((run.folder / "summary.json").read_text()) | {"floor": "\x1b[31m\ud800"}
    (run.folder / "summary.json").write_text(json.dumps(summary))
    assert main(["runs", str(tmp_path / "runs")]) == 0
    assert capsys.readouterr().out.rstrip("\n").isprintable()


def test_damaged_points_of_interest_hold_up_neither_goto_nor_command_center(
    sound_run: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    run = RunFolder(tmp_path / "run", sound_run)
    assert [finding.number for finding in findings_of_run(run.folder).values()] == ["101", "102"]
    (run.folder / "pois.json").write_text('[{"poi_id": 1}]')
    assert findings_of_run(run.folder) == {}
    assert "pois.json: key '[0].x_m' is missing" in caplog.text


def test_half_a_jpeg_is_no_photo(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    photo, config = tmp_path / "door.jpg", tmp_path / "robot.toml"
    photo.write_bytes(cv2.imencode(".jpg", chessboard_view(focal_px=900.0))[1].tobytes()[:-5000])
    assert main(["calibrate", "doors", str(photo), "--config", str(config)]) == 2
    assert "door.jpg is only a part of a picture" in capsys.readouterr().err
    assert not config.exists()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("cases", [60, slow(40_000)])
def test_damaged_run_folders_are_listed_and_exported_or_refused_in_a_sentence(
    cases: int, sound_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_database, "_BUSY_S", 0.05)
    damage, root = Damage(0), tmp_path / "runs"
    run, beside = RunFolder(root / "spoilt", sound_run), RunFolder(root / "sound", sound_run)
    slowest_s = 0.0
    for case in range(cases):
        run.spoil(damage)
        began_s = time.monotonic()
        assert main(["runs", str(root)]) == 0, case
        assert f"{beside.folder}  " in capsys.readouterr().out, case
        wanted = damage.chance.choice(tuple(EXPORTERS))
        code = main(["export", str(run.folder), "--to", str(tmp_path / "out"), "--format", wanted])
        assert_told(code, capsys.readouterr().err)
        slowest_s = max(slowest_s, time.monotonic() - began_s)
        run.mend()
    with capsys.disabled():
        print(f"\n{cases} damaged run folders, the slowest took {slowest_s:.2f} s")
    assert slowest_s < SLOWEST_S


def use(config: Config) -> None:
    """What the processes make of the values."""
    assert sign_rules(config.poi).room_number("A" * 100) == ""
    assert all(ColourBox.parse(text) for text in config.poi.door_colours)
    assert len(config.sonars.bearings_rad) == 5
    assert config.wheels.tick_m > 0
    if not config.mesh.keys:
        main_way("mmu", "peer", config)


def attempt(load: Callable[[], T], file: Path) -> T | None:
    """What came of it; None where it was refused in one sentence that names the file."""
    try:
        return load()
    except StartError as error:
        said = sentence(error)
    assert str(file) in said
    assert said.isprintable()
    return None


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("cases", [400, slow(40_000)])
def test_damaged_configurations_serve_or_are_refused_in_a_sentence(cases: int, tmp_path: Path) -> None:
    damage, file, sound = Damage(1), tmp_path / "robot.toml", config_text(Config()).encode()
    for _ in range(cases):
        file.write_bytes(damage.text_of(sound, damage.toml_of))
        config = attempt(lambda: load_config(file), file)
        if config is not None:
            use(config)
            assert parse_config(config_text(config)) == config


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("cases", [60, slow(20_000)])
def test_damaged_floors_and_events_serve_or_are_refused_in_a_sentence(cases: int, tmp_path: Path) -> None:
    damage, own = Damage(2), floor_path(DEFAULT_FLOOR).read_bytes()
    floor, events = tmp_path / "floor.json", tmp_path / "events.json"
    for case in range(cases):
        spoil_floor = case % 2 == 1
        floor.write_bytes(damage.text_of(own, damage.json_of) if spoil_floor else own)
        text = json.dumps(EVENTS).encode()
        events.write_bytes(text if spoil_floor else damage.text_of(text, damage.json_of))
        loaded = attempt(lambda: load_world(RunOptions(floor, events=events)), floor if spoil_floor else events)
        if loaded is not None:
            world, happening = loaded
            for now_s in (0.0, 40.0, *happening.change_times_s()):
                happening.walls_at(world, now_s)
                [person.position(now_s) for person in happening.people]


@pytest.mark.parametrize("cases", [12, slow(2_000)])
def test_damaged_photos_serve_or_are_refused_in_a_sentence(
    cases: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    damage, config = Damage(3), tmp_path / "robot.toml"
    config.write_text(config_text(Config()))
    board = chessboard_view(focal_px=900.0)
    sound = {suffix: cv2.imencode(suffix, board)[1].tobytes() for suffix in (".png", ".jpg")}
    for case in range(cases):
        suffix = damage.chance.choice((".png", ".jpg"))
        photo = tmp_path / f"photo{suffix}"
        photo.write_bytes(damage.bytes_of(sound[suffix]))
        verb = damage.chance.choice(("doors", "camera"))
        code = main(["calibrate", verb, str(photo), "--config", str(config)])
        assert_told(code, capsys.readouterr().err)
        assert load_config(config).poi.field_of_view_deg > 0, case


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_signs_are_read_in_damaged_photos_or_they_are_refused_in_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rapidocr")
    damage, photo, sidecar = Damage(4), tmp_path / "plate.jpg", tmp_path / "plate.json"
    picture = cv2.imencode(".jpg", plate_picture())[1].tobytes()
    place = json.dumps({"x_m": 2.0, "y_m": 1.0, "heading_rad": 0.0, "wall_m": 1.0}).encode()
    for case in range(100):
        photo.write_bytes(damage.bytes_of(picture) if case % 2 else picture)
        sidecar.write_bytes(place if case % 2 else damage.text_of(place, damage.json_of))
        code = main(["read-signs", str(tmp_path)])
        said = capsys.readouterr()
        assert_told(code, said.err)
        for line in said.out.splitlines():
            assert np.isfinite(json.loads(line).get("x_m", 0.0)), case


def command_lines(damage: Damage, folder: Path, sound_run: Path) -> Iterator[list[str]]:
    """Of every verb that reads files, one after the other, each over another damaged file; none begins a run."""
    runs, floor, events, config = (folder / name for name in ("runs", "floor.json", "events.json", "robot.toml"))
    own, out = floor_path(DEFAULT_FLOOR).read_bytes(), str(folder / "out")
    run = RunFolder(runs / "spoilt", sound_run)
    while True:
        run.spoil(damage)
        yield ["runs", str(runs)]
        yield ["export", str(run.folder), "--to", out]
        floor.write_bytes(damage.text_of(own, damage.json_of))
        yield ["local", "--floor", str(floor), "--start", "99"]
        events.write_bytes(damage.text_of(json.dumps(EVENTS).encode(), damage.json_of))
        yield ["local", "--events", str(events), "--start", "99"]
        config.write_bytes(damage.text_of(config_text(Config()).encode(), damage.toml_of))
        yield ["node", "bridge", "--config", str(config)]
        yield ["node", "comm", "--config", str(folder / "missing.toml")]
        run.mend()


@pytest.mark.parametrize("cases", [12, slow(200)])
def test_damaged_files_are_one_sentence_on_the_command_line(cases: int, sound_run: Path, tmp_path: Path) -> None:
    program = [sys.executable, "-m", "deploy.cli"]
    for words in islice(command_lines(Damage(6), tmp_path, sound_run), cases):
        ended = subprocess.run([*program, *words], capture_output=True, timeout=60, check=False)
        said = ended.stderr.decode()
        assert ended.returncode in ((0,) if words[0] == "runs" else (0, 2)), said
        assert "Traceback" not in said
        if ended.returncode == 2:
            (line,) = said.splitlines()
            assert re.fullmatch(r"(indoor-mapping|comm|bridge): .+\.", line), line
