"""SIM on the bench: gyro, dead reckoning, sonars, reports (SIM_MR_01..05)."""

from __future__ import annotations

import math
import random
from itertools import pairwise

import pytest

from common.constants import TICK_M
from offboard.simulator.electronics.board import HostBoard
from onboard.bridge.line_protocol import LineDecoder
from onboard.bridge.protocol import CarSta, Dst, Odo, OdoFlag, Rng, SimSta
from tests.firmware.bench import Bench, ready_bench


class NoisyBench(Bench):
    """White noise of 0.05 deg/s and a bias that jumped since the calibration."""

    noise = random.Random(3)

    def gyro_counts(self, rate_rad_s: float) -> int:
        rate_deg_s = math.degrees(rate_rad_s) + self.gyro_bias_deg_s + self.noise.gauss(0.0, 0.05)
        return round(rate_deg_s * 65.5)


def turned_cdeg(bench: Bench, since_cdeg: int) -> int:
    return (bench.odo.yaw_cdeg - since_cdeg + 18000) % 36000 - 18000


@pytest.mark.requirement("SIM_MR_01", "SIM_MR_05", "CAR_MR_06")
def test_everything_is_reported_ten_times_a_second() -> None:
    bench = ready_bench()
    bench.received.clear()
    bench.run(5.0)
    for kind in (Odo, Rng, Dst, SimSta, CarSta):
        assert len([m for m in bench.received if isinstance(m, kind)]) in (49, 50, 51), kind


@pytest.mark.requirement("SIM_MR_04")
def test_yaw_of_a_standing_robot_does_not_drift() -> None:
    bench = NoisyBench()
    bench.run(60.0)
    assert bench.odo.flags & OdoFlag.STANDING
    assert turned_cdeg(bench, 0) == pytest.approx(0, abs=20)


def test_bias_is_known_well_after_a_second_of_standing() -> None:
    errors = []
    for seed in range(12):
        bench = NoisyBench()
        bench.noise = random.Random(seed)
        bench.arm()
        bench.drive(1, 1, 0.0)
        bench.run(20.0)
        bench.gyro_bias_deg_s += 0.01  # what it wanders in that time
        bench.drive(2, 0, 0.0)
        bench.run(2.5)
        before, heading = bench.odo.yaw_cdeg, bench.heading_deg
        bench.drive(3, 1, 0.0)
        bench.run(10.0)
        drift_deg = turned_cdeg(bench, before) / 100 - (bench.heading_deg - heading)
        errors.append(drift_deg / 10.0)
    assert math.sqrt(sum(e * e for e in errors) / len(errors)) < 0.010


def test_a_rest_tells_what_the_yaw_lost_since_the_last_one() -> None:
    """Of a bias that walks, the end tells half of what it did on the way: sqrt(1 / 4) of the error is left, and what
    neither rest knows of it."""
    errors = []
    for seed in range(24):
        bench = NoisyBench()
        bench.noise = random.Random(seed)
        bench.arm()
        bench.run(2.0)
        before, heading = bench.odo.yaw_cdeg, bench.heading_deg
        bench.drive(1, 1, 0.0)
        for _ in range(30):
            bench.run(1.0)
            bench.gyro_bias_deg_s += bench.noise.gauss(0.0, 0.002)
        bench.drive(2, 0, 0.0)
        bench.run(2.5)
        errors.append(turned_cdeg(bench, before) / 100 - (bench.heading_deg - heading))
    assert math.sqrt(sum(e * e for e in errors) / len(errors)) < 0.15


def test_a_robot_that_is_turned_on_standing_wheels_learns_no_bias_from_it() -> None:
    bench = NoisyBench()
    bench.arm()
    bench.drive(1, 1, 0.0)
    bench.run(20.0)
    bench.drive(2, 0, 0.0)
    bench.run(0.5)
    before = bench.odo.yaw_cdeg
    bench.gyro_bias_deg_s += 0.35
    bench.run(1.4)
    bench.gyro_bias_deg_s -= 0.35
    bench.run(0.1)
    assert turned_cdeg(bench, before) == pytest.approx(49, abs=12)
    before, heading = bench.odo.yaw_cdeg, bench.heading_deg
    bench.drive(3, 1, 0.0)
    bench.run(20.0)
    drift_deg = turned_cdeg(bench, before) / 100 - (bench.heading_deg - heading)
    assert abs(drift_deg) < 1.0


@pytest.mark.parametrize(
    ("pitch_deg", "roll_deg"), [(0, 0), (12, 0), (-30, 0), (0, 20), (0, -75), (10, -40), (0, 170), (-85, 3)]
)
def test_pitch_and_roll_are_those_of_gravity(pitch_deg: float, roll_deg: float) -> None:
    pitch_rad, roll_rad = math.radians(pitch_deg), math.radians(roll_deg)
    gravity = (math.sin(pitch_rad), math.cos(pitch_rad) * math.sin(roll_rad), math.cos(pitch_rad) * math.cos(roll_rad))
    counts = [round(16384 * g) for g in gravity]
    board = HostBoard()
    for n in range(1, 100):
        board.imu(*counts, 0, 0, 0)
        board.run(n * 10_000)
    told = [r.message for r in LineDecoder().feed(board.serial_read()) if isinstance(r.message, SimSta)][-1]
    assert told.pitch_cdeg / 100 == pytest.approx(pitch_deg, abs=0.3)
    assert told.roll_cdeg / 100 == pytest.approx(roll_deg, abs=0.3 + abs(pitch_deg) / 40)


@pytest.mark.requirement("SIM_MR_02", "SIM_MR_03")
def test_dead_reckoning_follows_the_body() -> None:
    bench = ready_bench()
    for n, yaw in enumerate((0.0, 90.0, 180.0, 270.0)):
        bench.drive(1 + n, 1, yaw)
        bench.run(10.0)
    bench.drive(9, 0, 270.0)
    bench.run(3.0)
    assert bench.odo.x_mm == pytest.approx(bench.x_m * 1000, abs=10)
    assert bench.odo.y_mm == pytest.approx(bench.y_m * 1000, abs=10)
    assert bench.odo.yaw_cdeg / 100 == pytest.approx(bench.heading_deg % 360, abs=0.3)
    assert bench.odo.ticks_left * TICK_M == pytest.approx(bench.rolled_m[0], abs=0.001)


def test_boot_calibration_waits_until_the_robot_stands_still() -> None:
    bench = Bench()
    for n in range(600):
        bench.board.encoder_edges(n % 3, 0)
        bench.step()
    assert not bench.odo.flags & OdoFlag.CALIBRATED
    bench.run(2.6)
    assert bench.odo.flags & OdoFlag.CALIBRATED


@pytest.mark.parametrize("inches", [6, 20, 100, 254])
def test_ranges_are_millimetres_from_the_pulse_width(inches: int) -> None:
    bench = Bench()
    bench.echo_us = [inches * 147] * 5
    bench.run(1.0)
    ranges = [m for m in bench.received if isinstance(m, Rng)][-1]
    assert all(mm == pytest.approx(inches * 25.4, abs=0.6) for mm in ranges.range_mm)
    assert all(age <= 250 for age in ranges.age_ms)


def test_no_echo_is_nought_and_a_mute_sonar_is_an_error() -> None:
    bench = Bench()
    bench.run(1.0)
    assert [m for m in bench.received if isinstance(m, Rng)][-1].range_mm == (0, 0, 0, 0, 0)
    assert [m for m in bench.received if isinstance(m, SimSta)][-1].error == 0
    bench.echo_us[3] = 0
    bench.run(2.0)
    assert [m for m in bench.received if isinstance(m, SimSta)][-1].error == 101


def watched(bench: Bench) -> list[tuple[int, tuple[int, ...]]]:
    """When which sonars fire, as it happens."""
    firings: list[tuple[int, tuple[int, ...]]] = []
    original = bench.board.fired

    def watching() -> tuple[int, ...]:
        sonars = original()
        if sonars:
            firings.append((bench.now_us, sonars))
        return sonars

    bench.board.fired = watching  # type: ignore[method-assign]
    return firings


def test_opposite_sonars_fire_together_and_neighbours_49_ms_apart() -> None:
    bench = Bench()
    firings = watched(bench)
    bench.run(2.0)
    assert [sonars for _, sonars in firings[:4]] == [(0, 4), (1, 3), (2,), (0, 4)]
    gaps_us = [b[0] - a[0] for a, b in pairwise(firings)]
    assert min(gaps_us) >= 44_000
    assert sum(gaps_us) / len(gaps_us) == pytest.approx(49_000, abs=500)


@pytest.mark.parametrize(
    ("near", "order"),
    [
        (0, [(0, 4), (1, 3), (2,), (0, 4)]),
        (1, [(0, 4), (1, 3), (1, 3), (2,), (0, 4)]),
        (2, [(0, 4), (1, 3), (2,), (2,), (0, 4)]),
    ],
)
def test_who_hears_something_too_near_out_of_nowhere_is_asked_once_more(
    near: int, order: list[tuple[int, ...]]
) -> None:
    bench = Bench()
    firings = watched(bench)
    bench.echo_us[near] = 6 * 147  # and goes on to hear it
    bench.run(0.6)
    assert [sonars for _, sonars in firings[: len(order)]] == order
    assert [sonars for _, sonars in firings[len(order) : len(order) + 3]] == [(1, 3), (2,), (0, 4)]


def test_angled_sonars_count_for_front_or_side() -> None:
    bench = Bench()
    inch = 25.4
    bench.echo_us = [37500, 8 * 147, 60 * 147, 40 * 147, 30 * 147]
    bench.run(1.0)
    distances = [m for m in bench.received if isinstance(m, Dst)][-1]
    # Front left: 0.273 m from the centre at 45 deg, in the robot's way
    assert distances.front_mm == pytest.approx((8 * inch + 70) * math.sqrt(0.5), abs=3)
    assert distances.left_mm == 0
    # Right: 0.832 m straight and 0.768 m by the angled one, two witnesses of one wall
    assert distances.right_mm == pytest.approx((30 * inch + 70 + (40 * inch + 70) * math.sqrt(0.5)) / 2, abs=3)
