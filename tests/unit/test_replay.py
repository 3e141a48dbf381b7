"""The verb `replay`: which logs it takes, what it says of those it does not, and that it maps with any carrier."""

from __future__ import annotations

import time
from math import cos, inf, pi, radians, sin
from pathlib import Path

import numpy as np
import pytest

from common.geometry import Pose2, rigid_fit, wrap_angle
from common.messages.topics import MAP, POSE, TRAJECTORY
from deploy.cli import main
from offboard.command_center.run_player import RunPlayer
from offboard.replay.range_log import RangeLogError, read_range_log
from offboard.runs.map_assembly import MapAssembly
from offboard.runs.run_database import RunReader
from offboard.runs.run_folder import read_map_points, read_tum
from offboard.runs.run_schema import RunDatabase
from offboard.visualizer.run_view import recorded_run

BEARINGS_DEG = (90.0, 45.0, 0.0, -45.0, -90.0, 70.0, -70.0)
ROOM = ((-2.0, 12.0), (-1.5, 5.0))  # x and y of its walls
PERIOD_S = 0.2
SPEED_M_S = 0.4


def pencil_m(pose: Pose2, bearing_rad: float) -> float:
    """Range of a pencil beam to the walls of the room."""
    c, s = cos(pose.heading_rad + bearing_rad), sin(pose.heading_rad + bearing_rad)
    (x0, x1), (y0, y1) = ROOM
    along_x = ((x1 if c > 0 else x0) - pose.x_m) / c if abs(c) > 1e-9 else inf
    along_y = ((y1 if s > 0 else y0) - pose.y_m) / s if abs(s) > 1e-9 else inf
    return min(along_x, along_y)


def round_trip(drift_rad_per_m: float = 0.0) -> list[tuple[float, Pose2, Pose2]]:
    """Time, true pose and odometry of a drive round the room and a bit further."""
    truth = odometry = Pose2(0.0, 0.0, 0.0)
    drive: list[tuple[float, Pose2, Pose2]] = []
    for leg_m in (10.0, 3.5, 10.0, 3.5, 10.0, 3.5, 4.0):
        moves = [(SPEED_M_S * PERIOD_S, 0.0)] * round(leg_m / SPEED_M_S / PERIOD_S) + [(0.0, pi / 16)] * 8
        for way_m, turn_rad in moves:
            drive.append((len(drive) * PERIOD_S, truth, odometry))
            truth = truth.compose(Pose2(way_m, 0.0, turn_rad))
            odometry = odometry.compose(Pose2(way_m, 0.0, wrap_angle(turn_rad + drift_rad_per_m * way_m)))
    return drive


def written(path: Path, bearings_deg: tuple[float, ...] = BEARINGS_DEG, drift_rad_per_m: float = 0.0) -> Path:
    """The drive as a log in the shared format, ranges in centimetres."""
    lines = [
        f"# bearings_deg: {','.join(f'{b:g}' for b in bearings_deg)}",
        "# max_range_m: " + ",".join("8" for _ in bearings_deg),
    ]
    lines.append("t_s,odom_x_m,odom_y_m,odom_heading_rad," + ",".join(f"range{i}_m" for i in range(len(bearings_deg))))
    for t_s, truth, odometry in round_trip(drift_rad_per_m):
        ranges = [pencil_m(truth, radians(b)) for b in bearings_deg]
        cells = [f"{r:.2f}" if r < 8.0 else "" for r in ranges]
        lines.append(f"{t_s:.2f},{odometry.x_m:.5f},{odometry.y_m:.5f},{odometry.heading_rad:.6f}," + ",".join(cells))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def replayed(log: Path, out: Path, *more: str) -> tuple[float, float]:
    """Runs the verb; the worst error of the smoothed path and the 95th percentile of that of the map, in metres.

    Both once the map is laid on the room: which way its frame turns is free.
    """
    assert main(["replay", str(log), "--out", str(out), "--beam-half-width", "0", *more]) == 0
    truth = np.array([pose.as_array() for _, pose, _ in round_trip()])
    times_s, poses = read_tum(out / "trajectory_smoothed.tum")
    assert len(times_s) == len(truth)
    assert len(read_tum(out / "trajectory.tum")[0]) == len(truth)
    laid = rigid_fit(poses[:, :2], truth[:, :2])
    points = laid.transform(read_map_points(out / "map_points.csv")[0])
    (x0, x1), (y0, y1) = ROOM
    off_m = np.min(
        [abs(points[:, 0] - x0), abs(points[:, 0] - x1), abs(points[:, 1] - y0), abs(points[:, 1] - y1)], axis=0
    )
    return float(np.hypot(*(laid.transform(poses[:, :2]) - truth[:, :2]).T).max()), float(np.percentile(off_m, 95))


@pytest.mark.requirement("MMU_SR_05")
@pytest.mark.parametrize("beams", [(90.0, 45.0, 0.0, -45.0, -90.0), (90.0, 0.0, -90.0), BEARINGS_DEG])
def test_any_number_of_beams_maps_the_room(tmp_path: Path, beams: tuple[float, ...]) -> None:
    path_m, map_m = replayed(written(tmp_path / "log.csv", beams), tmp_path / "out")
    assert path_m < 0.10
    assert map_m < 0.06


@pytest.mark.requirement("MMU_SR_05")
def test_beams_can_be_picked_from_a_log_with_more(tmp_path: Path) -> None:
    log = written(tmp_path / "log.csv")
    path_m, _ = replayed(log, tmp_path / "out", "--beams", "90,0,-90,45")
    assert path_m < 0.10
    assert len(read_range_log(log, (70.0, -70.0)).bearings_rad) == 2


def test_wheels_that_turn_away_are_found_out_by_the_walls(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without a gyro: 2 degrees per metre, 90 degrees in the end."""
    path_m, map_m = replayed(written(tmp_path / "log.csv", drift_rad_per_m=radians(2.0)), tmp_path / "out")
    assert path_m < 0.5
    assert map_m < 0.2
    assert "step: mean" in capsys.readouterr().out


def test_a_slow_sensor_maps_too(tmp_path: Path) -> None:
    """Each tenth scan, 0.8 m apart, with wheels that turn away by half a degree per metre."""
    log = written(tmp_path / "log.csv", drift_rad_per_m=radians(0.5))
    lines = log.read_text(encoding="utf-8").splitlines()
    slow = tmp_path / "slow.csv"
    slow.write_text("\n".join(lines[:3] + lines[3::10]) + "\n", encoding="utf-8")
    assert main(["replay", str(slow), "--out", str(tmp_path / "out"), "--beam-half-width", "0"]) == 0
    truth = np.array([pose.as_array() for _, pose, _ in round_trip()])[::10]
    odometry = np.array([pose.as_array() for _, _, pose in round_trip(radians(0.5))])[::10]
    poses = read_tum(tmp_path / "out" / "trajectory_smoothed.tum")[1]
    off_m, odometry_off_m = (
        float(np.hypot(*(rigid_fit(p[:, :2], truth[:, :2]).transform(p[:, :2]) - truth[:, :2]).T).max())
        for p in (poses, odometry)
    )
    assert odometry_off_m > 0.5
    assert off_m < 0.3 * odometry_off_m


def changed(path: Path, line: int, text: str | None, old: str = "", new: str = "") -> Path:
    lines = path.read_text(encoding="utf-8").splitlines()
    lines[line - 1] = lines[line - 1].replace(old, new) if text is None else text
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("line", "text", "said"),
    [
        (3, "t_s,odom_x_m,odom_z_m,odom_heading_rad,range0_m", "line 3: column 3 must be odom_y_m, not odom_z_m"),
        (10, "1.0,2.0,3.0", "line 10: 3 columns where the header has 11"),
        (11, "1.0,2.0,3.0,x" + ",1" * 7, "line 11: could not convert"),
        (12, ",2.0,3.0,4.0" + ",1" * 7, "line 12: time and odometry must not be empty"),
        (1, "# bearings_deg: 90,left", "line 1: must be numbers"),
        (1, "# bearings_deg: 90,0", "line 2: max_range_m names 7 beams, bearings_deg 2"),
    ],
)
def test_a_log_with_a_wrong_column_names_the_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], line: int, text: str, said: str
) -> None:
    log = changed(written(tmp_path / "log.csv"), line, text)
    assert main(["replay", str(log), "--out", str(tmp_path / "out")]) == 2
    assert said in capsys.readouterr().err


def test_a_log_that_is_not_there_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(tmp_path / "none.csv"), "--out", str(tmp_path)]) == 2
    assert "cannot be read" in capsys.readouterr().err


def carmen(kind: str, ranges: list[float], t_s: float) -> str:
    laser = " ".join(f"{r:.2f}" for r in ranges)
    pose = "1.5 0.5 0.1"
    if kind == "FLASER":
        return f"FLASER {len(ranges)} {laser} 0 0 0 {pose} {t_s} host {t_s}"
    head = f"ROBOTLASER1 0 -1.570796 3.141593 {pi / (len(ranges) - 1):.7f} 50.0 0.01 0 {len(ranges)}"
    return f"{head} {laser} 0 0 0 0 {pose} 0.1 0.2 0.3 0.4 0.5 {t_s} host {t_s}"


@pytest.mark.parametrize("kind", ["FLASER", "ROBOTLASER1"])
def test_beams_of_a_carmen_log_are_those_of_its_laser(tmp_path: Path, kind: str) -> None:
    ranges = [1.0 + 0.01 * i for i in range(181)]  # from -90 to 90 degrees
    log = tmp_path / "carmen.log"
    log.write_text("\n".join(["PARAM x 1", *(carmen(kind, ranges, t) for t in (10.0, 10.2))]), encoding="utf-8")
    read = read_range_log(log)
    assert read.times_s.tolist() == [10.0, 10.2]
    assert read.poses[0] == pytest.approx([1.5, 0.5, 0.1])
    assert read.ranges_m[0] == pytest.approx([2.8, 2.35, 1.9, 1.45, 1.0])
    with pytest.raises(RangeLogError, match="line 2"):
        read_range_log(log, (120.0,))


def test_how_the_map_grew_is_recorded_in_the_log_s_time_and_ends_as_the_files_have_it(tmp_path: Path) -> None:
    log, out = written(tmp_path / "log.csv"), tmp_path / "out"
    RunDatabase(out / "run.sqlite", None, recorder_id=7).close()  # of an earlier one, which is replaced
    assert main(["replay", str(log), "--out", str(out)]) == 0
    with RunReader(out) as run:
        poses, updates = list(run.messages(POSE)), list(run.messages(MAP))
        paths = list(run.messages(TRAJECTORY))
    stamps_s = [message.arrived_s for message in poses]
    assert stamps_s == [message.payload.t_s for message in poses]
    assert (stamps_s[0], stamps_s[-1]) == (0.0, pytest.approx(read_tum(out / "trajectory.tum")[0][-1], abs=0.3))
    growing = MapAssembly()
    lengths = []
    for update in updates:
        growing.add(update.payload)
        lengths.append(len(growing))
    assert growing.missing == 0
    assert lengths[len(lengths) // 4] < 0.6 * lengths[-1]
    times_s, online = read_tum(out / "trajectory.tum")
    published = np.array([(m.payload.x_m, m.payload.y_m) for m in poses])
    at = np.searchsorted(times_s, np.array(stamps_s) - 1e-6)
    assert np.abs(online[at, :2] - published).max() < 1e-3
    walls_m = read_map_points(out / "map_points.csv")[0]
    some = growing.known()[0][:: max(1, len(growing) // 200)]
    near = np.array([np.hypot(*(walls_m - point).T).min() for point in some])
    assert np.percentile(near, 95) < 0.2
    assert len(paths) > 2


def test_page_and_terminal_play_how_the_map_grew(tmp_path: Path) -> None:
    log, out = written(tmp_path / "log.csv"), tmp_path / "out"
    assert main(["replay", str(log), "--out", str(out)]) == 0
    player = RunPlayer(out)
    page = recorded_run(out)
    assert page.playback is not None
    page.playback.open()
    try:
        whole = len(player.node.floor_picture().walls_m)
        middle_s = player.duration_s / 2
        player.jump(middle_s)
        half = len(player.node.floor_picture().walls_m)
        assert 0.1 * whole < half < 0.9 * whole
        page.playback.show(middle_s, 0.0)
        end_s = time.monotonic() + 20.0
        while len(page.feed.map_data().points_m) != half:
            assert time.monotonic() < end_s, "the page shows that moment too"
            time.sleep(0.02)
    finally:
        page.playback.close()
        player.close()
