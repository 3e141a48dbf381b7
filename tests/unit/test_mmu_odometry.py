"""Dead reckoning: what the filter makes of ticks and yaw, and of reports that do not go on."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from math import nan, pi, radians
from typing import Any

import pytest

from common.constants import TICK_M, WHEEL_TRACK_M
from common.geometry import Pose2, wrap_angle
from common.messages.motion import Odometry
from onboard.mmu.front_end.odometry import OdometryFilter

PERIOD_S = 0.1


def report(t_s: float, left_m: float, right_m: float, yaw_rad: float, session: int = 0) -> Odometry:
    return Odometry(
        t_s=t_s,
        ticks_left=round(left_m / TICK_M),
        ticks_right=round(right_m / TICK_M),
        yaw_rad=wrap_angle(yaw_rad),
        yaw_rate_rad_s=0.0,
        x_m=0.0,
        y_m=0.0,
        speed_m_s=0.0,
        standing=False,
        bumper=False,
        cliff=False,
        session=session,
    )


def drive(
    seconds: float,
    speed_m_s: float,
    turn_rad_s: float = 0.0,
    gyro_factor: float = 1.0,
    session: int = 0,
    start_s: float = 0.0,
) -> list[Odometry]:
    """Reports of one session; the wheels do what is asked, the gyro shows `gyro_factor` of the turn."""
    reports = []
    for i in range(round(seconds / PERIOD_S) + 1):
        t = i * PERIOD_S
        turned_rad = turn_rad_s * t
        reports.append(
            report(
                start_s + t,
                speed_m_s * t - turned_rad * WHEEL_TRACK_M / 2,
                speed_m_s * t + turned_rad * WHEEL_TRACK_M / 2,
                turned_rad * gyro_factor,
                session,
            )
        )
    return reports


def after(reports: Iterable[Odometry]) -> OdometryFilter:
    odometry = OdometryFilter()
    for one in reports:
        odometry.update(one)
    return odometry


def assert_at(pose: Pose2, x_m: float, y_m: float, heading_rad: float, tolerance: float = 0.01) -> None:
    assert pose.x_m == pytest.approx(x_m, abs=tolerance)
    assert pose.y_m == pytest.approx(y_m, abs=tolerance)
    assert wrap_angle(pose.heading_rad - heading_rad) == pytest.approx(0.0, abs=tolerance)


@pytest.mark.requirement("SIM_MR_02")
def test_straight_driving_moves_along_the_first_heading() -> None:
    assert_at(after(drive(10.0, 0.16)).pose, 1.6, 0.0, 0.0)


@pytest.mark.parametrize("turn_rad", [pi / 2, -pi / 2, 1.5 * pi])
def test_turning_on_the_spot_turns_the_heading_and_stays(turn_rad: float) -> None:
    assert_at(after(drive(5.0, 0.0, turn_rad / 5.0)).pose, 0.0, 0.0, turn_rad)


def test_a_quarter_circle_ends_beside_its_centre() -> None:
    assert_at(after(drive(10.0, pi / 2 * 0.1, pi / 20.0)).pose, 1.0, 1.0, pi / 2)


def test_the_gyro_leads_where_the_wheels_slip() -> None:
    """The wheels say 90 degrees, the gyro 80: rubber on a smooth floor."""
    pose = after(drive(5.0, 0.0, pi / 10.0, gyro_factor=80 / 90)).pose
    assert pose.heading_rad == pytest.approx(radians(80.0), abs=radians(2.0))


@pytest.mark.parametrize("before_s", [0.0, 10.0])
@pytest.mark.parametrize("rest_s", [0.0, 60.0])
def test_pose_follows_a_turn_by_hand_while_the_wheels_stand(before_s: float, rest_s: float) -> None:
    driven = drive(before_s, 0.16) or [report(0.0, 0.0, 0.0, 0.0)]
    resting = standing(driven[-1], rest_s)
    turned = standing(resting[-1] if resting else driven[-1], 2.0, radians(20.0))
    place = after([*driven, *resting]).pose
    pose = after([*driven, *resting, *turned]).pose
    assert pose.heading_rad - place.heading_rad == pytest.approx(radians(40.0), abs=radians(3.0))
    assert pose.distance_m(place) < 0.02


def standing(last: Odometry, seconds: float, turn_rad_s: float = 0.0) -> list[Odometry]:
    """Reports of a robot whose wheels stand, and whose gyro shows a turn."""
    turned = [(k * PERIOD_S, k * PERIOD_S * turn_rad_s) for k in range(1, round(seconds / PERIOD_S) + 1)]
    return [
        replace(last, t_s=last.t_s + t_s, yaw_rad=wrap_angle(last.yaw_rad + turn_rad), standing=True)
        for t_s, turn_rad in turned
    ]


def test_what_the_board_took_from_walls_counts_for_nothing() -> None:
    by_gyro = drive(5.0, 0.16, 0.1)
    aided = [replace(r, yaw_rad=wrap_angle(r.yaw_rad + 0.02 * r.t_s), yaw_by_walls_rad=0.02 * r.t_s) for r in by_gyro]
    pose = after(by_gyro).pose
    assert_at(after(aided).pose, pose.x_m, pose.y_m, pose.heading_rad, 1e-9)


def test_frame_begins_at_the_first_report_whatever_ticks_and_yaw_are() -> None:
    first = report(50.0, 12.0, 13.0, 2.0)
    odometry = OdometryFilter()
    odometry.update(first)
    assert_at(odometry.pose, 0.0, 0.0, 0.0)
    odometry.update(report(50.1, 12.016, 13.016, 2.0))
    assert_at(odometry.pose, 0.016, 0.0, 0.0, tolerance=1e-3)


def test_uncertainty_grows_with_the_path() -> None:
    near, far = after(drive(10.0, 0.16)), after(drive(40.0, 0.16))
    assert 0.0 < near.covariance[0, 0] < far.covariance[0, 0]


def test_position_is_kept_when_the_board_restarts() -> None:
    odometry = after(drive(10.0, 0.16))
    assert not odometry.update(report(11.0, 0.0, 0.0, 0.0, session=1))
    assert_at(odometry.pose, 1.6, 0.0, 0.0)
    assert odometry.update(report(11.1, 0.016, 0.016, 0.0, session=1))
    assert_at(odometry.pose, 1.616, 0.0, 0.0)


def test_heading_is_kept_when_the_board_restarts_after_a_turn() -> None:
    odometry = after(drive(5.0, 0.0, pi / 10.0))
    for restarted in drive(2.0, 0.16, session=1, start_s=6.0):
        odometry.update(restarted)
    assert_at(odometry.pose, 0.0, 0.32, pi / 2, tolerance=0.02)


def test_a_jump_of_the_ticks_is_no_motion() -> None:
    odometry = after(drive(5.0, 0.16))
    assert not odometry.update(report(5.1, 500.0, 500.0, 0.0))
    assert_at(odometry.pose, 0.8, 0.0, 0.0)


def test_a_repeated_report_changes_nothing() -> None:
    reports = drive(5.0, 0.16)
    assert_at(after([*reports, reports[-1], reports[-1]]).pose, 0.8, 0.0, 0.0)


def test_a_late_report_does_not_count_motion_twice() -> None:
    reports = drive(5.0, 0.16)
    late = [*reports[:30], reports[20], *reports[30:]]
    assert_at(after(late).pose, 0.8, 0.0, 0.0)


@pytest.mark.parametrize("field", ["yaw_rad", "yaw_by_walls_rad"])
def test_a_report_that_is_no_number_is_left_out(field: str) -> None:
    reports = drive(5.0, 0.16)
    broken = replace(reports[30], **{field: nan})
    assert_at(after([*reports[:30], broken, *reports[31:]]).pose, 0.8, 0.0, 0.0)


@pytest.mark.parametrize(
    "wild", [{"x_m": 1e5}, {"y_m": -1e5}, {"t_s": 1e9, "x_m": 1e5}, {"t_s": 1e9}, {"t_s": 1e9, "ticks_left": 2**31 - 1}]
)
def test_a_report_that_no_motion_of_this_robot_explains_moves_nothing_and_is_forgotten(wild: dict[str, Any]) -> None:
    reports = list(drive(4.0, 0.2))
    found = OdometryFilter()
    for report in reports[:20]:
        found.update(report)
    assert not found.update(replace(reports[20], **wild))
    for report in reports[21:]:
        assert found.update(report)
    assert_at(found.pose, 0.8, 0.0, 0.0, tolerance=0.05)


def test_time_that_leaps_for_good_is_believed_in_the_end() -> None:
    reports = [replace(report, t_s=report.t_s - 1000.0) for report in drive(2.0, 0.2)]
    found = OdometryFilter()
    found.update(replace(reports[0], t_s=5.0))
    assert [found.update(report) for report in reports[1:]][-1]
    assert found.kidnapped
