"""The battery sends the robot home in time, and never without need."""

from __future__ import annotations

from math import inf

import pytest

from common.constants import BATTERY_LOW_V
from onboard.planner.mission.battery_watch import RESERVE_S, SAMPLE_S, BatteryWatch


def seen(volts_per_s: float, seconds: float, full_v: float = 12.6, noise_v: float = 0.0) -> BatteryWatch:
    watch = BatteryWatch()
    for second in range(int(seconds)):
        watch.see(float(second), full_v - volts_per_s * second + (noise_v if second % 2 else -noise_v))
    return watch


def test_what_is_left_is_where_the_line_of_the_voltage_ends() -> None:
    watch = seen(0.002, 300.0, noise_v=0.1)
    assert watch.left_s == pytest.approx((12.6 - BATTERY_LOW_V) / 0.002 - 300.0, rel=0.1)


def test_it_calls_home_once_the_way_takes_what_is_left() -> None:
    watch = seen(0.002, 900.0)
    left_s = watch.left_s
    near_m, far_m = 1.0, (left_s - RESERVE_S) * 0.12
    assert not watch.calls_home(near_m)
    assert watch.calls_home(far_m)


@pytest.mark.parametrize(("volts_per_s", "full_v"), [(0.0, 12.0), (-0.001, 11.0), (0.001, 0.0)])
def test_a_steady_a_rising_and_an_unwired_battery_call_nobody(volts_per_s: float, full_v: float) -> None:
    watch = seen(volts_per_s, 600.0, full_v=full_v)
    assert watch.left_s == inf
    assert not watch.calls_home(1e4)


def test_without_a_line_the_voltage_itself_counts() -> None:
    assert seen(0.0, 4 * SAMPLE_S, full_v=BATTERY_LOW_V - 0.1).calls_home(0.0)
    assert not seen(0.0, 4 * SAMPLE_S, full_v=BATTERY_LOW_V + 0.1).calls_home(0.0)
    assert not BatteryWatch().calls_home(1e4)
