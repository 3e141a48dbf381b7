"""Damaged run folders, configurations, floors, events and photos: one sentence and exit code 2, never a traceback."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
import pytest

from common.config import Config
from common.config_file import config_text, load_config, parse_config
from common.errors import StartError, sentence
from common.zenoh_session import main_channel
from deploy import cli
from deploy.cli import main
from offboard.export.formats import EXPORTS
from offboard.runs import run_database
from offboard.simulator.run.options import DEFAULT_FLOOR, RunOptions, floor_path, load_world
from onboard.poi.doors.door_detection import ColourBox
from onboard.poi.signs.sign_reading import sign_rules
from tests.unit.damage import Damage, RunFolder, assert_told
from tests.unit.test_poi_frames import chessboard_view, plate_picture

T = TypeVar("T")
SLOWEST_S = 10.0  # of a case, on a machine that is busy with other things
EVENTS = {
    "people": [{"from_s": 20, "to_s": 60, "speed_m_s": 1.0, "radius_m": 0.25, "waypoints": [[6, 1], [9, 1]]}],
    "blocked": [{"from_s": 30, "to_s": 90, "line": [[9, 0], [9, 2]]}],
}


def slow(cases: int) -> Any:
    return pytest.param(cases, marks=[pytest.mark.slow, pytest.mark.timeout(6 * 3600)])


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("cases", [60, slow(20_000)])
def test_damaged_run_folders_are_listed_and_exported_or_refused_in_a_sentence(
    cases: int, sound_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_database, "_BUSY_S", 0.05)
    monkeypatch.setattr(cli, "build_parser", cache(cli.build_parser))  # to build it takes longer than a case
    damage, root = Damage(0), tmp_path / "runs"
    run, beside = RunFolder(root / "spoilt", sound_run), RunFolder(root / "sound", sound_run)
    slowest_s = 0.0
    for case in range(cases):
        run.spoil(damage)
        began_s = time.monotonic()
        assert main(["runs", str(root)]) == 0, case
        assert f"{beside.folder}  " in capsys.readouterr().out, case
        wanted = damage.chance.choice(tuple(EXPORTS))
        code = main(["export", str(run.folder), "--to", str(tmp_path / "out"), "--format", wanted])
        assert_told(code, capsys.readouterr().err)
        slowest_s = max(slowest_s, time.monotonic() - began_s)
        run.mend()
    with capsys.disabled():
        print(f"\n{cases} damaged run folders, the slowest took {slowest_s:.2f} s")
    assert slowest_s < SLOWEST_S


def use(config: Config) -> None:
    """What the processes make of the values."""
    forms = sign_rules(config.poi).forms
    assert forms.match("A" * 100) is None
    for line in ("Room 1O1", "16-186", "S1|07 WC"):
        number = forms.match(line)
        assert number is None or (forms.own | forms.foreign)[number.form].fullmatch(number.shown)
    assert all(ColourBox.parse(text) for text in config.poi.door_colours)
    assert len(config.sonars.bearings_rad) == 5
    assert config.wheels.tick_m > 0
    if not config.mesh.keys:
        main_channel("mmu", "peer", config)


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
@pytest.mark.parametrize("cases", [400, slow(60_000)])
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


@pytest.mark.parametrize("cases", [12, slow(500)])
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
    for case in range(40):
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
