"""What a person watches beside the map: how well the robot is received, when it will be home, whom to call."""

from __future__ import annotations

import dataclasses
from math import nan
from typing import Any

import numpy as np
import pytest

from common.errors import ErrorCode
from common.messages.health import Status
from common.messages.mapping import PoseEstimate
from common.messages.mission import Outcome, PlannerView
from common.messages.motion import CarrierReport, CarrierState, Ranges
from common.messages.topics import CARRIER, PLAN, RANGES, STATUS
from offboard.visualizer.feed import Feed
from offboard.visualizer.link_quality import LinkQuality
from offboard.visualizer.time_left import TimeLeft
from tests.page_socket import unpacked


def pose(t_s: float, x_m: float) -> PoseEstimate:
    return PoseEstimate(t_s, x_m, 0.0, 0.0, 0.0, 0.02, 0.01, 1)


def plan(mode: str = "FOLLOW", halls: int = 0, *path: tuple[float, float], **changes: Any) -> PlannerView:
    path_m = np.array(path, np.float32).reshape(-1, 2)
    return dataclasses.replace(PlannerView(0.0, mode, "exploring", path_m, halls, 40.0), **changes)


def test_poses_that_did_not_arrive_are_counted_by_the_robots_own_times() -> None:
    quality = LinkQuality()
    assert quality.share is None
    for k in range(100):
        if k % 4:  # a quarter is lost; the clock of this robot goes five times as fast
            quality.add(0.1 * k, 0.02 * k)
    assert quality.share == pytest.approx(0.75, abs=0.02)
    assert quality.longest_gap_s == pytest.approx(0.04)


def test_what_was_lost_ten_seconds_ago_counts_no_more_and_a_restarted_robot_begins_anew() -> None:
    quality = LinkQuality()
    for t_s in (0.0, 50.0):
        quality.add(t_s, t_s)
    assert quality.longest_gap_s == 50.0
    for k in range(1, 120):
        quality.add(50.0 + 0.1 * k, 50.0 + 0.1 * k)
    assert quality.share == pytest.approx(1.0)
    quality.add(3.0, 80.0)
    assert quality.share is None


def driven(left: TimeLeft, seconds: int, speed_m_s: float) -> None:
    for k in range(10 * seconds + 1):
        left.take_pose(pose(0.1 * k, 0.1 * k * speed_m_s))


def test_the_way_home_takes_as_long_as_the_speed_so_far_says() -> None:
    left = TimeLeft()
    assert left.seconds is None
    driven(left, 100, 0.2)
    left.take_plan(plan("HOME", 2, (10.0, 0.0), (0.0, 0.0)))
    assert left.speed_m_s == pytest.approx(0.2, rel=0.02)
    assert left.seconds == pytest.approx(100.0, rel=0.02)


def test_an_exploration_takes_longer_with_every_open_hall_by_what_a_hall_took_so_far() -> None:
    left = TimeLeft()
    left.take_plan(plan(halls=3))
    driven(left, 100, 0.2)
    left.take_plan(plan(halls=2))  # one hall in 20 m
    with_two = left.seconds
    left.take_plan(plan(halls=3))
    assert with_two is not None
    assert left.seconds == pytest.approx(with_two + 100.0, rel=0.02)


@pytest.mark.parametrize(
    "changes", [{"paused": True}, {"mode": "DONE", "outcome": Outcome.ARRIVED}, {"mode": "WAITING"}]
)
def test_nobody_can_tell_of_a_robot_that_waits(changes: dict[str, Any]) -> None:
    left = TimeLeft()
    driven(left, 100, 0.2)
    left.take_plan(plan("HOME", 0, (0.0, 0.0)))
    assert left.seconds is not None
    left.take_plan(dataclasses.replace(plan("HOME", 0, (0.0, 0.0)), **changes))
    assert left.seconds is None


def told(feed: Feed, channel: str) -> dict[str, Any]:
    """What a page that is opened now is told on a channel."""
    client = feed.client()
    for call in (client.urgent, lambda: client.bulk(channel)):
        while (message := call()) is not None:
            head, _ = unpacked(message)
            if head["channel"] == channel:
                return head
    return {}


def status(module: str, code: int = 0, memory_kb: int = 100, cpu_share: float = 0.0) -> Status:
    return Status(0.0, "RUN", code, memory_kb, True, 1, cpu_share=cpu_share)


def test_ranges_go_out_as_echoes_and_none_where_nothing_answered() -> None:
    feed = Feed(clock=lambda: 5.0)
    feed.take(RANGES, Ranges(0.0, (1.0, nan, 2.5, 0.777, nan), (0.0,) * 5))
    assert told(feed, "ranges")["range_m"] == [1.0, None, 2.5, 0.78, None]


def test_the_battery_is_shown_and_low_when_the_board_says_so() -> None:
    feed = Feed()
    carrier = CarrierReport(0.0, CarrierState.MOVING, 0, 0, 0, 0.2, 0, 0, True, False, 11.84)
    feed.take(CARRIER, carrier)
    assert (told(feed, "vitals")["battery_v"], told(feed, "vitals")["battery_low"]) == (11.84, False)
    feed.take(STATUS["bridge"], status("bridge", ErrorCode.BATTERY_LOW))
    assert told(feed, "vitals")["battery_low"]


def test_memory_and_processor_of_ten_minutes_go_out_as_the_most_of_each_ten_seconds() -> None:
    now_s = [0.0]
    feed = Feed(clock=lambda: now_s[0])
    for k in range(400):
        now_s[0] = 0.1 * k
        feed.take(STATUS["mmu"], status("mmu", memory_kb=1000 + k, cpu_share=0.5 if k == 150 else 0.1))
    told_of = told(feed, "health")
    assert told_of["modules"] == {"mmu": {"memory_kb": [1099, 1199, 1299], "cpu_percent": [10, 50, 10]}}
    assert told_of["sample_s"] == 10.0


def test_a_person_is_called_at_the_end_and_for_what_only_people_can_end() -> None:
    feed = Feed()
    feed.take(STATUS["comm"], status("comm", ErrorCode.BATTERY_LOW))
    assert told(feed, "alerts") == {}, "before the mission is known nobody is called"
    feed.take(PLAN, plan())
    assert list(told(feed, "alerts")["alerts"]) == ["comm 104"]
    feed.take(STATUS["comm"], status("comm"))
    feed.take(PLAN, plan("DONE", outcome=Outcome.FINISHED))
    assert told(feed, "alerts")["alerts"] == {"FINISHED": "The mission has ended: finished, and home."}
