"""Inputs that come late, doubled, out of order, not at all or broken; a board that restarts; a process that does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import cos, inf, nan, pi
from pathlib import Path

import numpy as np
import pytest

from common.constants import TICK_M, WHEEL_TRACK_M
from common.geometry import Pose2
from common.messages.motion import Odometry, Ranges
from onboard.mmu.back_end.map_builder import deferred_back_end
from onboard.mmu.map.map_file import SavedMap, load_map
from onboard.mmu.slam import Slam
from tests.unit.mmu_scenes import ranges_to, ring

PERIOD_S = 0.1
SPEED_M_S = 0.3
ROOM = ((-2.0, 10.0), (-1.2, 1.4))  # x and y of the walls; the robot starts in the origin, heading along x
WALLS = np.array(ring(ROOM[0][0], ROOM[1][0], ROOM[0][1], ROOM[1][1]))

ORIGIN = Pose2(0.0, 0.0, 0.0)

Report = tuple[Odometry, Ranges]


def reports(seconds: float, start: Pose2 = ORIGIN, session: int = 1, begin_s: float = 0.0) -> list[Report]:
    """Up and down the room; the board counts from where it was switched on."""
    pose, turning_rad = start, 0.0
    left_m = right_m = 0.0
    out: list[Report] = []
    for i in range(round(seconds / PERIOD_S)):
        t_s = begin_s + i * PERIOD_S
        board = start.between(pose)
        ticks = round(left_m / TICK_M), round(right_m / TICK_M)
        odometry = Odometry(
            t_s, *ticks, board.heading_rad, 0.0, board.x_m, board.y_m, SPEED_M_S, False, False, False, session
        )
        out.append((odometry, Ranges(t_s, ranges_to(pose, WALLS), (0.0,) * 5)))
        ahead_m = pose.x_m + 2.0 * cos(pose.heading_rad)
        if turning_rad <= 0.0 and not ROOM[0][0] + 1.0 < ahead_m < ROOM[0][1] - 1.0:
            turning_rad = pi
        turn_rad = min(turning_rad, 0.12)
        turning_rad -= turn_rad
        path_m = 0.0 if turn_rad else SPEED_M_S * PERIOD_S
        left_m += path_m - turn_rad * WHEEL_TRACK_M / 2
        right_m += path_m + turn_rad * WHEEL_TRACK_M / 2
        pose = pose.compose(Pose2(path_m, 0.0, turn_rad))
    return out


def true_pose(report: Report, start: Pose2 = ORIGIN) -> Pose2:
    odometry = report[0]
    return start.compose(Pose2(odometry.x_m, odometry.y_m, odometry.yaw_rad))


def fed(messages: list[Report], slam: Slam | None = None) -> Slam:
    slam = slam or Slam(deferred_back_end())
    for odometry, ranges in messages:
        slam.add_odometry(odometry)
        slam.add_ranges(ranges)
    return slam


def off_m(slam: Slam, report: Report) -> float:
    return slam.pose.distance_m(true_pose(report))


DRIVE = reports(60.0)


def doubled() -> list[Report]:
    return [report for report in DRIVE for _ in range(2)]


def out_of_order() -> list[Report]:
    return [DRIVE[i + 1 if i % 10 == 4 else i - 1 if i % 10 == 5 else i] for i in range(len(DRIVE))]


def late_ranges() -> list[Report]:
    return [(odometry, DRIVE[max(i - 3, 0)][1]) for i, (odometry, _) in enumerate(DRIVE)]


def broken_now_and_then() -> list[Report]:
    out = list(DRIVE)
    for i in range(20, len(out), 37):
        odometry, ranges = out[i]
        bad = (replace(odometry, yaw_rad=nan), replace(odometry, t_s=nan), replace(odometry, ticks_left=10**8))[i % 3]
        wrong = (
            replace(ranges, range_m=(nan, inf, -1.0, 0.0, nan)),
            replace(ranges, age_s=(nan,) * 5),
            replace(ranges, range_m=(1.0,), age_s=(0.0,)),
            replace(ranges, t_s=nan),
        )[i % 4]
        out[i] = (bad, wrong)
    return out


def five_seconds_missing() -> list[Report]:
    return DRIVE[:150] + DRIVE[200:]


@pytest.mark.requirement("MMU_SR_04")
@pytest.mark.parametrize("messages", [doubled, out_of_order, late_ranges, broken_now_and_then, five_seconds_missing])
def test_whatever_happens_to_the_inputs_the_pose_stays_true(messages: Callable[[], list[Report]]) -> None:
    slam = fed(messages())
    assert off_m(slam, DRIVE[-1]) < 0.15
    points = slam.wall_points()
    (x0, x1), (y0, y1) = ROOM
    walls = np.stack([abs(points[:, 0] - x0), abs(points[:, 0] - x1), abs(points[:, 1] - y0), abs(points[:, 1] - y1)])
    assert len(points) > 100
    assert np.percentile(walls.min(axis=0), 95) < 0.10


def test_a_board_that_restarts_goes_on_where_it_stood() -> None:
    first = DRIVE[:300]
    stands = true_pose(first[-1])
    slam = fed(first)
    begun_s = first[-1][0].t_s + 3.0
    again = reports(20.0, stands, session=2, begin_s=begun_s)
    fed(again, slam)
    assert slam.pose.distance_m(true_pose(again[-1], stands)) < 0.2
    assert slam.uncertainty.sd_m < 1.0


def test_ticks_that_jump_for_good_make_the_pose_uncertain() -> None:
    slam = fed(DRIVE[:200])
    assert slam.uncertainty.sd_m < 1.0
    jumped = [
        (replace(o, ticks_left=o.ticks_left + 10**6, ticks_right=o.ticks_right + 10**6), r) for o, r in DRIVE[200:220]
    ]
    fed(jumped, slam)
    assert slam.uncertainty.sd_m == inf


def saved_after(messages: list[Report], file: Path) -> SavedMap:
    fed(messages, Slam(deferred_back_end(file)))
    saved = load_map(file)
    assert saved is not None
    assert len(saved.poses) > 10
    return saved


@pytest.mark.requirement("MMU_MR_03")
def test_a_process_that_restarts_goes_on_in_its_map(tmp_path: Path) -> None:
    """The board counted on while the process was away for five seconds."""
    saved = saved_after(DRIVE[:400], tmp_path / "map.npz")
    slam = fed(DRIVE[450:], Slam(deferred_back_end(), saved=saved))
    assert slam.uncertainty.sd_m < 1.0
    assert off_m(slam, DRIVE[-1]) < 0.2
    assert len(slam.trajectory()[1]) > len(saved.poses)
    assert slam.map.wall_count > len(saved.echoes)


def test_a_robot_that_may_have_been_kidnapped_knows_nothing_at_first(tmp_path: Path) -> None:
    saved = saved_after(DRIVE[:400], tmp_path / "map.npz")
    slam = fed(reports(1.0, session=9), Slam(deferred_back_end(), saved=saved))
    assert slam.uncertainty.sd_m == inf
    assert np.isfinite(slam.pose.as_array()).all()
