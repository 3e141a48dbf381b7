"""Run folders that a crash, a full disk or a person has damaged: `runs` and `export` say what is wrong, and where."""

from __future__ import annotations

import errno
import json
import os
import sqlite3
from pathlib import Path
from typing import Any

import pytest

from deploy.cli import main
from offboard.command_center.places import findings_of_run
from offboard.runs import run_database
from offboard.runs.run_folder import read_tum
from tests.unit.damage import RunFolder, assert_told


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


@pytest.mark.parametrize("verb", ["runs", "export"])
@pytest.mark.parametrize("content", [None, [], ["summary.json"]])
def test_a_folder_without_a_run_is_one_sentence_with_what_to_do(
    verb: str, content: list[str] | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "empty"
    for name in content or []:
        folder.mkdir()
        (folder / name).write_text("{}")
    if content == []:
        folder.mkdir()
    words = [verb, str(folder)] + (["--to", str(tmp_path / "out")] if verb == "export" else [])
    code = main(words)
    error = capsys.readouterr().err
    assert_told(code, error)
    assert str(folder) in error
    assert "`indoor-mapping" in error
    assert not (tmp_path / "out").exists()


def test_a_run_that_has_no_map_yet_is_listed_and_exported_with_what_it_holds(
    sound_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    run, out = RunFolder(tmp_path / "runs" / "young", sound_run), tmp_path / "out"
    for name in ("map_points.csv", "pois.json", "summary.json", "trajectory_smoothed.tum"):
        (run.folder / name).unlink(missing_ok=True)
    assert main(["runs", str(tmp_path / "runs")]) == 0
    assert str(run.folder) in capsys.readouterr().out
    assert main(["export", str(run.folder), "--to", str(out), "--format", "csv,tum"]) == 0
    assert [file.name for file in out.iterdir()] == ["trajectory.tum"]
    assert f"{run.folder} holds no map yet, only run.sqlite, trajectory.tum." in caplog.text
    caplog.clear()
    (run.folder / "pois.json").write_text("{}")
    assert main(["export", str(run.folder), "--to", str(out), "--format", "svg"]) == 2
    assert "pois.json must hold a list" in capsys.readouterr().err
    assert not caplog.text, "a run that is refused is told of in one sentence"
