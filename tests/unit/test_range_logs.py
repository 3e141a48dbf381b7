"""Range logs of other people: every kind is read as it was meant and what was mended is said, or refused with its line.

What is read like the plain log maps like it, so most kinds are compared as read; some are mapped.
"""

from __future__ import annotations

import gzip
from collections.abc import Callable
from math import pi, radians
from pathlib import Path

import numpy as np
import pytest
from range_log_scenes import BEGAN_S, HEADER, PERIOD_S, ROUND, STEP_M, carmen_lines, csv_lines, drive, map_off_m

from common.geometry import Pose2, wrap_angles
from deploy.cli import main
from offboard.replay.range_log import RangeLog, RangeLogError, read_range_log

MAP_OFF_MAX_M = 0.03
RESET, GLITCH = 60, 40  # frames
FIRST_FRAME_LINE = 4  # of a CSV log


def written(path: Path, lines: list[str]) -> Path:
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def read(tmp_path: Path, lines: list[str]) -> RangeLog:
    return read_range_log(written(tmp_path / "some.log", lines))


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> RangeLog:
    return read(tmp_path_factory.mktemp("plain"), csv_lines())


def assert_same(log: RangeLog, plain: RangeLog, late_s: float = 0.02) -> None:
    """The same frames, at the same times from the first on but for `late_s`."""
    assert log.times_s - log.times_s[0] == pytest.approx(plain.times_s, abs=late_s)
    assert log.poses == pytest.approx(plain.poses, abs=2e-3)
    assert log.bearings_rad == pytest.approx(plain.bearings_rad, abs=1e-3)
    assert np.array_equal(np.isnan(log.ranges_m), np.isnan(plain.ranges_m))
    assert log.ranges_m == pytest.approx(plain.ranges_m, abs=2e-3, nan_ok=True)
    assert log.goes_on.all()


def mapped(tmp_path: Path, lines: list[str], legs: int = ROUND) -> int:
    """Runs the verb over a pencil of light's log; how many points the map has, once all of them lie on walls."""
    log, out = written(tmp_path / "some.log", lines), tmp_path / "out"
    assert main(["replay", str(log), "--out", str(out), "--beam-half-width", "0"]) == 0
    off_m, points = map_off_m(out, legs)
    assert off_m < MAP_OFF_MAX_M
    return points


# ---- clocks ----

CLOCKS: dict[str, tuple[Callable[[int, float], float], str]] = {
    "milliseconds": (lambda _, t_s: 1.2e12 + t_s * 1e3, "taken for milliseconds"),
    "microseconds": (lambda _, t_s: t_s * 1e6, "taken for microseconds"),
    "nanoseconds": (lambda _, t_s: 1.2e18 + t_s * 1e9, "taken for nanoseconds"),
    "milliseconds as if they were seconds": (lambda _, t_s: round(t_s / 1e3, 6), "taken for thousands"),
    "seconds since 1970": (lambda _, t_s: 1.2e9 + t_s, ""),
    "a stamp that is 2^32 too late": (lambda i, t_s: t_s + (2**32 if i == 1 else 0), "line 5: a stamp that lies else"),
    "a stamp of zero now and then": (lambda i, t_s: 0 if i in (50, 80) else 9e8 + t_s, "line 54 and 1 more: a stamp"),
    "a first stamp of zero": (lambda i, t_s: 9e8 + t_s if i else 0.0, "line 4: a stamp"),
    "a board that restarts": (lambda i, t_s: t_s - (50 * PERIOD_S if i >= 50 else 0), "line 54: the clock was set"),
    "a counter that wraps": (lambda i, t_s: (t_s + 4285.0) % 4294.967296, "the clock was set anew"),
    "a clock that is put forward": (lambda i, t_s: t_s + (1e6 if i >= 50 else 0), "line 54: the clock was set"),
    "a clock that stands for a while": (lambda i, t_s: 10.0 if 40 < i < 70 else t_s, ""),
}


@pytest.mark.parametrize("kind", CLOCKS)
def test_whatever_the_clock_the_frames_keep_their_times(tmp_path: Path, plain: RangeLog, kind: str) -> None:
    stamp, said = CLOCKS[kind]
    log = read(tmp_path, csv_lines(stamp))
    assert_same(log, plain, late_s=PERIOD_S)
    assert said in " ".join(log.notes)
    assert bool(said) == bool(log.notes)


def test_frames_of_a_clock_that_stands_follow_each_other_by_their_order(tmp_path: Path, plain: RangeLog) -> None:
    log = read(tmp_path, csv_lines(lambda *_: 5.0))
    assert np.diff(log.times_s) == pytest.approx(np.diff(log.times_s)[0])
    assert log.poses == pytest.approx(plain.poses)
    assert "line 4: the clock stands still" in log.notes[0]


def test_of_the_two_clocks_of_a_carmen_line_the_one_that_runs_counts(tmp_path: Path, plain: RangeLog) -> None:
    lines = [
        line.replace(f" {line.split()[-3]} host", " 7.0 host") if "host" in line else line for line in carmen_lines()
    ]
    assert_same(read(tmp_path, lines), plain)


# ---- limits ----


@pytest.mark.parametrize("silent", ["0", "-1", "inf", "nan", "1e9", "81.91", "655.35", "2.5", "2.500"])
def test_a_range_at_or_above_the_limit_is_no_echo(tmp_path: Path, plain: RangeLog, silent: str) -> None:
    assert_same(read(tmp_path, csv_lines(silent=silent)), plain)


@pytest.mark.parametrize("silent", ["2.55", "81.91", "655.35"])
def test_a_longest_range_that_recurs_is_no_echo_where_no_limit_is_told(
    tmp_path: Path, plain: RangeLog, silent: str
) -> None:
    log = read(tmp_path, [line for line in csv_lines(silent=silent) if "max_range" not in line])
    assert_same(log, plain)
    assert f"ranges of {silent} m" in log.notes[0]


def test_the_limit_of_a_carmen_log_is_the_one_it_tells(tmp_path: Path, plain: RangeLog) -> None:
    assert_same(read(tmp_path, carmen_lines(silent="30.00", parameters=("robot_front_laser_max 30.0",))), plain)
    assert_same(read(tmp_path, carmen_lines("ROBOTLASER1", silent="2.500")), plain)


def test_a_person_can_set_the_limit(tmp_path: Path, plain: RangeLog) -> None:
    log = written(tmp_path / "some.log", csv_lines())
    nearer = read_range_log(log, max_range_m=2.0)
    assert np.nanmax(nearer.ranges_m) < 2.0 < np.nanmax(plain.ranges_m)
    assert main(["replay", str(log), "--out", str(tmp_path / "out"), "--max-range", "-1"]) == 2


# ---- odometry ----


def test_odometry_that_began_anew_makes_a_piece_that_is_tied_by_what_it_sees(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    began = drive(10)[RESET]
    lines = csv_lines(odometry=lambda i, pose: pose if i < RESET else began.between(pose), legs=10)
    mapped(tmp_path, lines, legs=10)
    said = capsys.readouterr().err
    assert f"line {RESET + FIRST_FRAME_LINE}: odometry does not go on" in said
    assert "was recognised" not in said


def test_a_piece_that_was_never_recognised_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    began = drive(3)[RESET]
    mapped(tmp_path, csv_lines(odometry=lambda i, pose: pose if i < RESET else began.between(pose), legs=3), legs=3)
    said = f"line {RESET + FIRST_FRAME_LINE}: nothing seen from here on was recognised"
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("20 km", lambda pose: Pose2(20_000.0, pose.y_m, pose.heading_rad)),
        ("1e20 m", lambda pose: Pose2(1e20, -1e20, pose.heading_rad)),
        ("zero", lambda pose: Pose2(0.0, 0.0, 0.0)),
        ("half a turn", lambda pose: Pose2(pose.x_m, pose.y_m, pose.heading_rad + pi)),
    ],
)
def test_a_pose_out_of_reach_lies_between_its_neighbours(
    tmp_path: Path, plain: RangeLog, name: str, told: Callable[[Pose2], Pose2]
) -> None:
    log = read(tmp_path, csv_lines(odometry=lambda i, pose: told(pose) if i == GLITCH else pose))
    assert_same(log, plain)
    assert f"line {GLITCH + FIRST_FRAME_LINE}: odometry is out of reach" in log.notes[0]


def test_odometry_that_is_not_ready_at_first_begins_once_it_is(tmp_path: Path, plain: RangeLog) -> None:
    log = read(tmp_path, csv_lines(odometry=lambda i, p: Pose2(1e29, -1e29, 0.0) if i < 2 else p))
    assert log.poses[2:] == pytest.approx(plain.poses[2:], abs=2e-3)
    assert log.poses[:2] == pytest.approx(plain.poses[:2], abs=2 * STEP_M)
    assert "line 4 and 1 more: odometry is out of reach" in log.notes[0]


def test_odometry_may_begin_anywhere(tmp_path: Path, plain: RangeLog) -> None:
    log = read(tmp_path, csv_lines(odometry=lambda _, p: Pose2(p.x_m + 4.5e5, p.y_m + 5.4e6, p.heading_rad)))
    assert log.poses[:, :2] - log.poses[0, :2] == pytest.approx(plain.poses[:, :2], abs=1e-3)
    assert not log.notes


def test_a_log_that_was_played_twice_is_the_same_place_twice(tmp_path: Path, plain: RangeLog) -> None:
    lines = csv_lines()
    log = read(tmp_path, lines + lines[3:])
    assert log.poses == pytest.approx(np.concatenate([plain.poses, plain.poses]), abs=2e-3)
    assert (np.diff(log.times_s) > 0).all()
    assert len(log.notes) == 2


def test_headings_in_degrees_and_bearings_in_radians_are_recognised(tmp_path: Path, plain: RangeLog) -> None:
    lines = csv_lines(odometry=lambda _, p: Pose2(p.x_m, p.y_m, float(np.degrees(p.heading_rad))))
    log = read(tmp_path, lines)
    assert_same(log, plain)
    assert "degrees" in log.notes[0]
    lines = ["# bearings_deg: 1.5708,0.7854,0,-0.7854,-1.5708", *csv_lines()[1:]]
    log = read(tmp_path, lines)
    assert_same(log, plain)
    assert "line 1" in log.notes[0]
    assert "radians" in log.notes[0]


@pytest.mark.parametrize("scale", [1000.0, 100.0])
def test_a_log_in_other_units_of_length_is_refused(tmp_path: Path, scale: float) -> None:
    with pytest.raises(RangeLogError, match=r"line [45]: .* metres"):
        read(tmp_path, csv_lines(scale=scale))
    with pytest.raises(RangeLogError, match=r"line 5: .* metres"):
        read(tmp_path, csv_lines(odometry=lambda _, p: Pose2(scale * p.x_m, scale * p.y_m, p.heading_rad)))


def test_frames_far_apart_are_mapped_as_far_as_they_allow(tmp_path: Path) -> None:
    lines = csv_lines(legs=ROUND)
    assert mapped(tmp_path, lines[:3] + lines[3::7]) > 20


def test_a_log_that_shows_no_wall_says_what_is_needed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = written(tmp_path / "some.log", csv_lines()[:6])
    assert main(["replay", str(log), "--out", str(tmp_path / "out")]) == 0
    assert "no wall was found" in capsys.readouterr().err


# ---- lasers ----


@pytest.mark.parametrize("kind", ["FLASER", "ROBOTLASER1"])
@pytest.mark.parametrize("laser", [Pose2(0.25, 0.1, 0.0), Pose2(-0.2, 0.0, pi / 2)], ids=["off centre", "turned"])
def test_the_pose_of_the_laser_on_the_robot_counts(tmp_path: Path, kind: str, laser: Pose2) -> None:
    log = read(tmp_path, carmen_lines(kind, laser=laser))
    assert log.centre_m == pytest.approx([laser.x_m, laser.y_m], abs=1e-3)
    off_rad = np.array(log.bearings_rad) - laser.heading_rad - np.radians([90, 45, 0, -45, -90])
    assert wrap_angles(off_rad) == pytest.approx(np.zeros(5), abs=1e-3)
    assert log.poses == pytest.approx(np.array([p.as_array() for p in drive()]), abs=1e-3)


def test_a_laser_off_centre_and_turned_maps_the_floor(tmp_path: Path) -> None:
    assert mapped(tmp_path, carmen_lines("ROBOTLASER1", laser=Pose2(0.2, -0.15, 1.0), silent="2.5", legs=ROUND)) > 600


def test_the_pose_of_a_laser_may_stand_in_parameters_only(tmp_path: Path) -> None:
    offsets = ("robot_frontlaser_offset 0.25", "robot_frontlaser_side_offset 0.1", "robot_frontlaser_angular_offset 90")
    log = read(tmp_path, carmen_lines(laser=Pose2(0.25, 0.1, pi / 2), parameters=offsets, told=False))
    assert log.centre_m == pytest.approx([0.25, 0.1])
    assert max(log.bearings_rad) == pytest.approx(pi)  # 90 degrees to the left of a laser that looks to the left


def test_corrected_poses_in_a_carmen_log_are_no_mounting(tmp_path: Path, plain: RangeLog) -> None:
    lines = []
    for i, line in enumerate(carmen_lines()):
        words = line.split()
        if words[0] == "FLASER":
            words[39] = f"{float(words[39]) + 0.01 * i:.4f}"
        lines.append(" ".join(words))
    log = read(tmp_path, lines)
    assert log.centre_m == pytest.approx([0.0, 0.0])
    assert_same(log, plain)


@pytest.mark.parametrize(
    ("sweep", "parameters"),
    [
        ((55, -135.0, 5.0), ("laser_front_laser_fov 4.712389", "laser_front_laser_resolution 5")),
        ((55, -135.0, 5.0), ("laser_front_laser_fov 270",)),
        ((55, -135.0, 5.0), ("laser_front_laser_resolution 5",)),
        ((49, -120.0, 5.0), ("laser_front_laser_resolution 0.0872665",)),
        ((73, -180.0, 5.0), ("laser_front_laser_fov 360",)),
        ((72, -180.0, 5.0), ("laser_front_laser_fov 360",)),
    ],
)
def test_the_field_of_view_of_a_carmen_log_is_the_one_it_tells(
    tmp_path: Path, plain: RangeLog, sweep: tuple[int, float, float], parameters: tuple[str, ...]
) -> None:
    lines = carmen_lines(sweep=sweep, parameters=parameters)
    assert_same(read(tmp_path, lines), plain)
    untold = [line for line in lines if "PARAM" not in line]
    told = read_range_log(
        written(tmp_path / "untold.log", untold), field_of_view_deg=sweep[2] * (sweep[0] - sweep[0] % 2)
    )
    assert_same(told, plain)


def test_a_laser_that_turns_clockwise_or_sees_less_is_read(tmp_path: Path, plain: RangeLog) -> None:
    assert_same(read(tmp_path, carmen_lines("ROBOTLASER1", sweep=(37, 90.0, -5.0))), plain)
    log = read(tmp_path, carmen_lines(sweep=(21, -50.0, 5.0), parameters=("laser_front_laser_fov 100",)))
    assert max(log.bearings_rad) == pytest.approx(radians(50.0))
    assert len(log.bearings_rad) == 5


@pytest.mark.parametrize("words", [3, 6], ids=["without stamps", "with one pose only"])
def test_old_laser_lines_are_read(tmp_path: Path, plain: RangeLog, words: int) -> None:
    lines = [" ".join(line.split()[:-words]) if line.startswith("FLASER") else line for line in carmen_lines()]
    log = read(tmp_path, lines)
    assert log.poses == pytest.approx(plain.poses, abs=2e-3)
    assert (np.diff(log.times_s) > 0).all()


def test_remissions_may_be_there_or_not(tmp_path: Path, plain: RangeLog) -> None:
    lines = carmen_lines("ROBOTLASER2")
    assert_same(read(tmp_path, lines), plain)
    words = [line.split() for line in lines]
    without = [" ".join(w[:46] + w[47:]) if w[0] == "ROBOTLASER2" else " ".join(w) for w in words]
    assert_same(read(tmp_path, without), plain)
    more = [" ".join([*w[:46], "3", "9", "9", "9", *w[47:]]) if w[0] == "ROBOTLASER2" else " ".join(w) for w in words]
    assert_same(read(tmp_path, more), plain)


def test_the_first_laser_line_may_come_late(tmp_path: Path, plain: RangeLog) -> None:
    lines = carmen_lines()
    lines[1:1] = [f"ODOM 0 0 0 0 0 0 {BEGAN_S} host 0"] * 3000
    assert_same(read(tmp_path, lines), plain)


# ---- text ----

TEXTS: dict[str, Callable[[str], bytes]] = {
    "byte order mark": lambda text: text.encode("utf-8-sig"),
    "UTF-16": lambda text: text.encode("utf-16"),
    "Latin-1 comment": lambda text: ("# Aufnahme im Büro\x85: 2\n" + text).encode("latin-1"),
    "gzip": lambda text: gzip.compress(text.encode()),
    "lines of Windows": lambda text: text.replace("\n", "\r\n").encode(),
    "lines of an old Mac": lambda text: text.replace("\n", "\r").encode(),
    "no end of the last line": lambda text: text.rstrip("\n").encode(),
    "blank lines": lambda text: text.replace("\n", "\n\n").encode(),
    "comments between": lambda text: text.replace("\n", "\n# note\n").encode(),
}
CELLS: dict[str, Callable[[str], bytes]] = {
    "semicolons": lambda text: text.replace(",", ";").encode(),
    "semicolons and decimal commas": lambda text: text.replace(",", ";").replace(".", ",").encode(),
    "tabs": lambda text: text.replace(HEADER, HEADER.replace(",", "\t")).replace(",", "\t").encode(),
    "quotes and capitals": lambda text: text.replace(
        HEADER, ",".join(f'"{n.upper()}"' for n in HEADER.split(","))
    ).encode(),
    "the header again": lambda text: (text + text.split("\n", 2)[2].split("\n")[0] + "\n").encode(),
    "commas at the ends": lambda text: "".join(
        f"{line},\n" if line[0] != "#" else f"{line}\n" for line in text.splitlines()
    ).encode(),
    "columns in another order": lambda text: "".join(
        line + "\n" if line[0] == "#" else ",".join(line.split(",")[k] for k in (8, 3, 0, 4, 1, 2, 7, 6, 5)) + "\n"
        for line in text.splitlines()
    ).encode(),
}


@pytest.mark.parametrize("kind", [*TEXTS, *CELLS])
def test_a_csv_log_may_be_written_in_many_ways(tmp_path: Path, plain: RangeLog, kind: str) -> None:
    log = tmp_path / "some.csv"
    log.write_bytes((TEXTS | CELLS)[kind]("\n".join(csv_lines()) + "\n"))
    assert_same(read_range_log(log), plain)


@pytest.mark.parametrize("kind", TEXTS)
def test_a_carmen_log_may_be_written_in_many_ways(tmp_path: Path, plain: RangeLog, kind: str) -> None:
    log = tmp_path / "some.log"
    log.write_bytes(TEXTS[kind]("\n".join(carmen_lines()) + "\n"))
    assert_same(read_range_log(log), plain)


def test_a_last_line_that_is_cut_off_costs_one_frame(tmp_path: Path) -> None:
    for lines in (csv_lines(), carmen_lines()):
        log = tmp_path / "some.log"
        log.write_text("\n".join(lines)[:-30], encoding="utf-8")
        rest = read_range_log(log)
        assert len(rest.times_s) == len(drive()) - 1
        assert f"line {len(lines)} is cut off" in " ".join(rest.notes)


# ---- refused ----


def with_line(lines: list[str], number: int, text: str) -> list[str]:
    return [*lines[: number - 1], text, *lines[number:]]


def words_changed(lines: list[str], number: int, at: int, word: str) -> list[str]:
    words = lines[number - 1].split()
    words[at] = word
    return with_line(lines, number, " ".join(words))


ROBOT = carmen_lines("ROBOTLASER1", silent="2.5")
REFUSED: dict[str, tuple[list[str], str]] = {
    "nothing": ([""], "is no CARMEN log, and a CSV log needs"),
    "no frames": (csv_lines()[:3], "too few scans, 0"),
    "one frame": (csv_lines()[:4], "too few scans, 1"),
    "no header": (csv_lines()[:2], "no header"),
    "odometry only": (["ODOM 0 0 0 0 0 0 1.0 host 1.0"] * 9, "its lines are ODOM"),
    "raw laser": (["RAWLASER1 0 0 1 1 1 1 0 1 1 0 1.0 host 1.0"] * 9, "its lines are RAWLASER1"),
    "a bearing of nan": (["# bearings_deg: nan,45,0,-45,-90", *csv_lines()[1:]], "line 1: .*nan"),
    "a limit of zero": (with_line(csv_lines(), 2, "# max_range_m: 4,4,0,4,4"), "line 2: .*above 0"),
    "other bearings midway": (csv_lines() + ["# bearings_deg: 0,1"], "another bearings_deg than in line 1"),
    "no echo at all": ([*csv_lines()[:3], *(f"{i},{i / 20},0,0,,,,," for i in range(9))], "line 4: .*no range"),
    "a time of nan": (with_line(csv_lines(), 9, "nan,0,0,0,1,1,1,1,1"), "line 9: 'nan'"),
    "odometry of inf": (with_line(csv_lines(), 9, "1,inf,0,0,1,1,1,1,1"), "line 9: 'inf'"),
    "a word of 10 MB": (with_line(csv_lines(), 9, "x" * 10_000_000), "line 9: 1 columns"),
    "odometry of nan": (words_changed(carmen_lines(), 20, 42, "nan"), "line 20: 'nan'"),
    "no readings": (with_line(carmen_lines(), 20, "FLASER 0 0 0 0 0 0 0 5.0 h 5.0"), "line 20: 0 readings"),
    "fewer than none": (words_changed(carmen_lines(), 20, 1, "-37"), "line 20: -37 readings"),
    "10^9 readings": (words_changed(carmen_lines(), 20, 1, "1000000000"), "line 20: 1000000000 readings are named"),
    "10^400 readings": (words_changed(carmen_lines(), 20, 1, "1" + 400 * "0"), "line 20: '1000"),
    "half a reading": (words_changed(carmen_lines(), 20, 1, "36.5"), "line 20: 36.5 readings"),
    "a count that is a word": (words_changed(carmen_lines(), 20, 1, "many"), "line 20: could not convert 'many'"),
    "a step of zero": (words_changed(ROBOT, 20, 4, "0.0"), "line 20: the angle between its beams is 0"),
    "a step of a turn": (words_changed(ROBOT, 20, 4, "5"), "line 20: .*more than a turn"),
    "a step of nearly zero": (words_changed(ROBOT, 20, 4, "1e-320"), "line 20: .*does not look"),
    "a line that ends early": (with_line(ROBOT, 20, ROBOT[19][:200]), "line 20: 37 readings"),
    "a field of view of nan": (carmen_lines(parameters=("laser_front_laser_fov nan",)), "line 2: 'nan'"),
    "a field of view of zero": (carmen_lines(parameters=("laser_front_laser_fov 0",)), "--field-of-view"),
    "odometry that jumps all the time": (
        csv_lines(odometry=lambda i, p: Pose2(p.x_m + 9.0 * (i // 8 % 2), p.y_m, p.heading_rad)),
        "line 12: here and [0-9]+ times more",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", REFUSED)
def test_what_cannot_be_used_is_refused_in_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    lines, said = REFUSED[kind]
    log = written(tmp_path / "some.log", lines)
    assert main(["replay", str(log), "--out", str(tmp_path / "out")]) == 2
    err = capsys.readouterr().err
    assert len(err) < 500
    assert err.count("\n") == 1
    with pytest.raises(RangeLogError, match=said):
        read_range_log(log)


@pytest.mark.parametrize("data", [b"\x1f\x8b\x08\x00broken", bytes(range(256)), b"\xff\xfe\x00"])
def test_what_is_no_text_is_refused(tmp_path: Path, data: bytes) -> None:
    log = tmp_path / "some.log"
    log.write_bytes(data)
    with pytest.raises(RangeLogError, match=r"some\.log"):
        read_range_log(log)
    with pytest.raises(RangeLogError, match="directory"):
        read_range_log(tmp_path)
