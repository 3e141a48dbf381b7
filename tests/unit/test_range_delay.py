"""How old the ranges of a range log are against its odometry."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from common.geometry import FloatArray, Pose2, wrap_angle
from offboard.replay.range_delay import poses_at, range_delay_s
from offboard.replay.range_log import read_range_log
from tests.unit.range_log_scenes import BEARINGS_DEG, PERIOD_S, ROUND, csv_lines, drive, heard


def odometry(delay_s: float) -> tuple[FloatArray, FloatArray]:
    """Times and poses beside ranges that are so much older."""
    poses = np.array([pose.as_array() for pose in drive(ROUND)])
    times_s = PERIOD_S * np.arange(len(poses))
    return times_s, poses_at(times_s, poses, -delay_s)


def ranges() -> FloatArray:
    """(N, beams) of the drive, NaN for no echo."""
    ranges_m = np.array(heard(ROUND))
    ranges_m[~np.isfinite(ranges_m)] = np.nan
    return ranges_m


@pytest.mark.parametrize("delay_s", [-0.15, 0.0, 0.1, 0.2])
def test_beams_that_see_the_same_walls_measure_the_delay(delay_s: float) -> None:
    measured_s = range_delay_s(*odometry(delay_s), ranges(), np.radians(BEARINGS_DEG))
    assert measured_s == pytest.approx(delay_s, abs=0.02)


def test_a_log_whose_ranges_are_older_is_read_with_the_odometry_of_their_time(tmp_path: Path) -> None:
    delayed = odometry(0.15)[1]
    log_path = tmp_path / "delayed.log.csv"
    lines = csv_lines(odometry=lambda i, _: Pose2.from_array(delayed[i]), legs=ROUND)
    log_path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    log = read_range_log(log_path)
    assert "0.15 s older than the odometry" in " ".join(log.notes)
    off_rad = [abs(wrap_angle(own[2] - pose.heading_rad)) for own, pose in zip(log.poses, drive(ROUND), strict=True)]
    assert np.percentile(off_rad, 90) < np.radians(2.0), "it was 6 degrees in every turn"


def test_too_short_a_log_shows_no_delay() -> None:
    times_s, poses = odometry(0.15)
    assert range_delay_s(times_s[:50], poses[:50], ranges()[:50], np.radians(BEARINGS_DEG)) == 0.0
