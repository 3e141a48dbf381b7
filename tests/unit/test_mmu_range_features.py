"""Where do ranges of a moving sonar place echoes, and where do they place none?"""

from __future__ import annotations

import pickle
from collections.abc import Callable
from math import cos, degrees, floor, nan, pi, radians, sin

import numpy as np
import pytest

from common.constants import SONAR_BEARINGS_RAD, SONAR_STEP_M
from common.geometry import Pose2, wrap_angle
from onboard.mmu.front_end.range_features import Echo, RangeFeatures, Ray, pose_at

LEFT = radians(90.0)
SPEED_M_S = 0.16
PERIOD_S = 0.1

RangeAt = Callable[[Pose2], float]


def rounded(range_m: float) -> float:
    """As the sonar reports it: whole steps, downwards."""
    return floor(range_m / SONAR_STEP_M) * SONAR_STEP_M


def plane(normal_rad: float, offset_m: float) -> RangeAt:
    """Range to the plane whose foot, from the origin, lies `offset_m` away in direction `normal_rad`."""
    return lambda pose: rounded(offset_m - pose.x_m * cos(normal_rad) - pose.y_m * sin(normal_rad))


def drive(
    ranges: dict[float, RangeAt], seconds: float = 15.0, speed_m_s: float = SPEED_M_S, heading_rad: float = 0.0
) -> tuple[list[Echo], list[Ray]]:
    """Drive straight on with one sonar per bearing; everything that was placed along the path."""
    features = RangeFeatures(tuple(ranges))
    poses: list[tuple[float, Pose2]] = []
    echoes: list[Echo] = []
    rays: list[Ray] = []
    for i in range(round(seconds / PERIOD_S)):
        t = i * PERIOD_S
        path_m = speed_m_s * t
        poses.append((t, Pose2(path_m * cos(heading_rad), path_m * sin(heading_rad), heading_rad)))
        ranges_m = tuple(range_at(poses[-1][1]) for range_at in ranges.values())
        new_echoes, new_rays = features.add(t, poses[-60:], ranges_m, (0.0,) * len(ranges_m))
        echoes += new_echoes
        rays += new_rays
    return echoes, rays


@pytest.mark.requirement("MMU_MR_03")
def test_wall_beside_the_path_echoes_square_to_it() -> None:
    echoes, _ = drive({LEFT: plane(pi / 2, 1.21)})
    assert len(echoes) > 20
    for echo in echoes:
        assert echo.y_m == pytest.approx(1.21, abs=0.03)
        assert degrees(echo.normal_rad) == pytest.approx(90.0, abs=5.0)


@pytest.mark.requirement("MMU_MR_01")
def test_a_wall_gets_at_least_ten_points_per_metre() -> None:
    echoes, _ = drive({LEFT: plane(pi / 2, 1.2)})
    along_m = np.sort([echo.x_m for echo in echoes])
    assert np.ptp(along_m) > 1.5
    assert np.diff(along_m).max() < 0.1


@pytest.mark.parametrize("normal_deg", [70.0, 110.0])
def test_the_change_of_the_range_shows_an_oblique_wall(normal_deg: float) -> None:
    normal_rad = radians(normal_deg)
    echoes, _ = drive({LEFT: plane(normal_rad, 2.0)}, seconds=10.0)
    assert len(echoes) > 10
    directions = np.array([echo.normal_rad for echo in echoes])
    assert degrees(float(np.median(directions))) == pytest.approx(normal_deg, abs=2.0)
    off_m = np.array([e.x_m * cos(normal_rad) + e.y_m * sin(normal_rad) for e in echoes]) - 2.0
    assert np.abs(off_m).max() < 0.05


def test_wall_ahead_is_placed_ahead() -> None:
    echoes, _ = drive({0.0: plane(0.0, 4.0)}, seconds=12.0)
    assert len(echoes) > 10
    # The cosine hardly changes around straight ahead: the direction is known to 12 degrees only, the distance well
    assert [echo.x_m for echo in echoes] == pytest.approx([4.0] * len(echoes), abs=0.10)
    assert max(abs(echo.y_m) for echo in echoes) < 1.0


@pytest.mark.requirement("MMU_SR_05")
@pytest.mark.parametrize("heading_deg", [0.0, 130.0, -90.0])
@pytest.mark.parametrize("mounted_deg", [90.0, 75.0, -60.0])
def test_any_mounting_and_way_of_driving_gives_the_same_wall(mounted_deg: float, heading_deg: float) -> None:
    side = 1.0 if mounted_deg > 0 else -1.0
    normal_rad = wrap_angle(radians(heading_deg) + side * pi / 2)
    echoes, _ = drive({radians(mounted_deg): plane(normal_rad, 1.5)}, heading_rad=radians(heading_deg))
    assert len(echoes) > 10
    off_m = [e.x_m * cos(normal_rad) + e.y_m * sin(normal_rad) - 1.5 for e in echoes]
    assert np.abs(off_m).max() < 0.05


def test_an_echo_outside_of_the_beam_is_not_placed() -> None:
    """What a side sonar cannot hear: a range that falls as fast as the robot drives comes from straight ahead."""
    assert drive({LEFT: plane(0.0, 4.0)}, seconds=12.0)[0] == []


def test_cross_talk_places_no_echo_and_does_not_disturb_the_wall() -> None:
    random = np.random.default_rng(3)
    wall = plane(pi / 2, 1.21)

    def disturbed(pose: Pose2) -> float:
        return rounded(float(random.uniform(0.3, 6.0))) if random.random() < 0.15 else wall(pose)

    echoes, _ = drive({LEFT: disturbed}, seconds=30.0)
    assert len(echoes) > 20
    assert max(abs(echo.y_m - 1.21) for echo in echoes) < 0.08


def test_noise_alone_places_hardly_an_echo() -> None:
    random = np.random.default_rng(4)
    assert len(drive({LEFT: lambda _: rounded(float(random.uniform(0.3, 6.0)))}, seconds=30.0)[0]) <= 3  # of 300


def test_a_standing_robot_places_no_echo() -> None:
    assert drive({b: plane(b, 1.2) for b in SONAR_BEARINGS_RAD}, speed_m_s=0.0)[0] == []


def test_an_hour_of_standing_takes_no_memory() -> None:
    features = RangeFeatures((LEFT,))
    size = []
    for i in range(3000):
        features.add(i * PERIOD_S, [(i * PERIOD_S, Pose2(0.0, 0.0, 0.0))], (1.0,), (0.0,))
        if i in (500, 2999):
            size.append(len(pickle.dumps(features)))
    assert size[1] < 1.5 * size[0]


def test_a_sonar_that_hears_nothing_places_nothing_and_frees_no_certain_distance() -> None:
    echoes, rays = drive({LEFT: lambda _: nan})
    assert echoes == []
    assert rays
    assert all(ray.free_m == float("inf") for ray in rays)


def test_one_lost_echo_neither_ends_a_wall_nor_frees_it() -> None:
    count = 0

    def now_and_then_lost(pose: Pose2) -> float:
        nonlocal count
        count += 1
        return nan if count % 7 == 0 else plane(pi / 2, 1.21)(pose)

    echoes, rays = drive({LEFT: now_and_then_lost})
    assert len(echoes) > 20
    assert max(ray.free_m for ray in rays) < 1.3


def test_the_same_range_reported_twice_counts_once() -> None:
    features = RangeFeatures((LEFT,))
    poses = [(0.0, Pose2(0.0, 0.0, 0.0)), (0.1, Pose2(0.02, 0.0, 0.0))]
    rays = [
        ray
        for t, age in ((0.0, 0.0), (0.1, 0.1), (0.2, 0.2), (0.3, 0.3))
        for ray in features.add(t, poses, (1.0,), (age,))[1]
    ]
    assert rays == []


def test_pose_between_two_reports_is_interpolated_also_across_half_a_turn() -> None:
    poses = [(1.0, Pose2(0.0, 0.0, radians(170.0))), (2.0, Pose2(1.0, 2.0, radians(-170.0)))]
    middle = pose_at(poses, 1.5)
    assert (middle.x_m, middle.y_m) == pytest.approx((0.5, 1.0))
    assert abs(middle.heading_rad) == pytest.approx(pi)
    assert pose_at(poses, 0.0) == poses[0][1]
    assert pose_at(poses, 9.0) == poses[1][1]


def test_a_beam_that_turns_hears_the_same_wall_wherever_its_axis_points_and_frees_little() -> None:
    """The end wall of a side hall, far off: rays along the axis would sweep over the walls of the hall."""
    features = RangeFeatures((LEFT,))
    poses: list[tuple[float, Pose2]] = []
    rays: list[Ray] = []
    for i in range(60):
        poses.append((0.1 * i, Pose2(0.0, 0.0, radians(2.0) * min(i, 30))))
        rays += features.add(poses[-1][0], poses[-60:], (4.0,), (0.0,))[1]
    *turning, standing = rays[1:]
    assert len(turning) > 10
    assert max(ray.free_m for ray in turning) < 2.0
    assert standing.free_m == pytest.approx(4.0)


def test_a_slanted_beam_frees_no_further_than_the_wall_beside_it_goes_on() -> None:
    """What it hears is a corner off its axis: the wall itself does not echo at that slant."""
    near, far = plane(pi / 2, 0.8), plane(pi / 2, 3.0)
    for beside, limit_m in ((near, 0.8 * 2**0.5), (far, 1.5)):
        _, rays = drive({LEFT: beside, radians(45.0): lambda _: 3.5, 0.0: lambda _: nan})
        slanted = [ray.free_m for ray in rays if ray.bearing_rad == radians(45.0)]
        assert slanted
        assert max(slanted) == pytest.approx(limit_m, abs=SONAR_STEP_M)
