"""The operator's side of the software stop: what is sent, what counts as confirmed, what a person sees."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from offboard.command_center.snapshot import Snapshot
from offboard.command_center.software_stop import (
    LINK_LOST_S,
    RELEASE_TIMEOUT_S,
    SOURCE,
    Demand,
    Look,
    RobotReport,
    StopControl,
    heard,
    look,
    pressed,
    release_asked,
    release_hindrance,
    request,
)
from offboard.command_center.widgets.stop_bar import bar_text

DRIVING = RobotReport((), 9.95, False, 0.16, 9.95)
STOPPED = RobotReport((SOURCE,), 10.2, True, 0.0, 10.2)
IDLE = StopControl()


def test_a_press_is_sent_until_latch_and_standing_wheels_are_both_heard_after_it() -> None:
    control = pressed(IDLE, DRIVING, 10.0)
    sent = request(control, 10.0)
    assert sent is not None
    assert sent.latched
    latched_only = replace(STOPPED, standing=False)
    standing_only = replace(STOPPED, stop_sources=())
    before_the_press = replace(STOPPED, odometry_s=9.9)
    for report in (DRIVING, latched_only, standing_only, before_the_press):
        assert heard(control, report, 10.25) == control
    done = heard(control, STOPPED, 10.25)
    assert request(done, 10.25) is None
    assert done.latency_s == pytest.approx(0.2)


def test_to_press_again_changes_nothing() -> None:
    control = pressed(IDLE, DRIVING, 10.0)
    assert pressed(control, DRIVING, 10.1) is control
    done = heard(control, STOPPED, 10.25)
    assert pressed(done, STOPPED, 10.3) is done
    assert look(done, STOPPED, 10.3) is Look.LATCHED


def test_a_press_without_a_link_is_sent_even_when_a_stop_was_latched_before() -> None:
    done = heard(pressed(IDLE, DRIVING, 10.0), STOPPED, 10.25)
    later_s = 10.25 + LINK_LOST_S + 1.0
    again = pressed(done, STOPPED, later_s)
    assert again.demand is Demand.STOP
    assert look(again, STOPPED, later_s) is Look.LINK_LOST


def test_a_stop_of_another_source_does_not_count_as_the_operators() -> None:
    bumper = replace(STOPPED, stop_sources=("hardware_button",))
    assert look(IDLE, bumper, 10.2) is Look.LATCHED
    control = pressed(IDLE, bumper, 10.2)
    assert control.demand is Demand.STOP
    both = replace(STOPPED, stop_sources=("hardware_button", SOURCE), permit_s=10.4, odometry_s=10.4)
    assert heard(control, both, 10.4).demand is Demand.NONE


@pytest.mark.parametrize(
    ("control", "report", "now_s", "said"),
    [
        (IDLE, STOPPED, 20.0, "not heard"),
        (StopControl(Demand.STOP, 10.0), STOPPED, 10.3, "not confirmed yet"),
        (IDLE, replace(STOPPED, stop_sources=("hardware_button", SOURCE)), 10.3, "hardware_button"),
        (IDLE, DRIVING, 10.0, "No stop"),
    ],
)
def test_a_release_is_hindered_with_a_reason(
    control: StopControl, report: RobotReport, now_s: float, said: str
) -> None:
    assert said in release_hindrance(control, report, now_s)
    assert release_asked(control, report, now_s) is control


def test_a_release_ends_with_the_robots_word_or_is_told_as_failed() -> None:
    control = release_asked(IDLE, STOPPED, 10.3)
    sent = request(control, 10.3)
    assert sent is not None
    assert not sent.latched
    assert heard(control, replace(STOPPED, permit_s=10.4), 10.4) is control
    freed = replace(STOPPED, stop_sources=(), permit_s=10.4)
    assert heard(control, freed, 10.4) == IDLE
    late_s = 10.3 + RELEASE_TIMEOUT_S + 0.1
    failed = heard(control, replace(STOPPED, permit_s=late_s), late_s)
    assert (failed.demand, failed.release_failed) == (Demand.NONE, True)


def test_a_press_ends_a_release_at_once() -> None:
    control = release_asked(IDLE, STOPPED, 10.3)
    assert pressed(control, STOPPED, 10.35).demand is Demand.STOP


REPORTS = st.builds(
    RobotReport,
    st.sets(st.sampled_from([SOURCE, "hardware_button"])).map(lambda s: tuple(sorted(s))),
    st.floats(0.0, 20.0),
    st.booleans(),
    st.floats(-0.3, 0.3),
    st.floats(0.0, 20.0),
)


@given(REPORTS, st.sampled_from(list(Demand)), st.floats(0.0, 20.0))
def test_latched_is_only_shown_on_the_robots_own_fresh_word(
    report: RobotReport, demand: Demand, since_s: float
) -> None:
    now_s = 20.0
    control = StopControl(demand, since_s)
    shown = look(control, report, now_s)
    if shown in (Look.LATCHED, Look.IDLE):
        assert now_s - report.permit_s <= LINK_LOST_S
        assert (shown is Look.LATCHED) == bool(report.stop_sources)
    text = bar_text(Snapshot(now_s, control=control, report=report))
    assert ("robot confirmed" in text.headline) <= (shown is Look.LATCHED)
    assert text.headline


def test_wheels_that_turn_under_a_latched_stop_are_told() -> None:
    turning = replace(STOPPED, standing=False, speed_m_s=0.12)
    text = bar_text(Snapshot(10.3, report=turning))
    assert text.headline == "LATCHED – wheels turn, speed 0.12"
    assert "red button" in text.detail
