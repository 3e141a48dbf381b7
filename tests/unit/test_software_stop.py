"""The operator's side of the software stop: what is sent, what counts as confirmed, what a person sees."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.messages.stop import Permit
from offboard.command_center.snapshot import Snapshot
from offboard.command_center.widgets.stop_bar import bar_text
from offboard.operate.software_stop import (
    LINK_LOST_S,
    RELEASE_TIMEOUT_S,
    SOURCE,
    Demand,
    Look,
    RobotReport,
    StopControl,
    look,
    pressed,
    release_hindrance,
    release_requested,
    request,
    updated,
)
from offboard.operate.stop_desk import StopDesk

GRANTED = Permit(0.0, True, "", stop_epoch=4)
LATCHED = Permit(0.0, False, "stopped by operator", (SOURCE,), stop_epoch=5, stop_ids=(7,), resumed=False)
DRIVING = RobotReport(GRANTED, 9.95, False, 0.16, 9.95, board_epoch=4)
STOPPED = RobotReport(LATCHED, 10.2, True, 0.0, 10.2, board_epoch=5, board_stands=True)
RELEASED = replace(STOPPED, permit=replace(LATCHED, stop_sources=(), stop_ids=()), permit_s=10.4)
IDLE = StopControl()


def with_permit(report: RobotReport, **changes: Any) -> RobotReport:
    return replace(report, permit=replace(report.permit, **changes))


def test_a_press_is_sent_until_this_very_press_is_latched_known_to_the_board_and_the_wheels_stand() -> None:
    control = pressed(IDLE, 10.0, 7)
    sent = request(control, 10.0)
    assert sent is not None
    assert (sent.latched, sent.stop_id) == (True, 7)
    for report in (
        DRIVING,
        with_permit(STOPPED, stop_ids=(6,)),
        with_permit(STOPPED, stop_epoch=0),
        replace(STOPPED, board_epoch=4),
        replace(STOPPED, board_stands=False),
        replace(STOPPED, standing=False),
        replace(STOPPED, odometry_s=9.9),
    ):
        assert updated(control, report, 10.25) == control
    done = updated(control, STOPPED, 10.25)
    assert request(done, 10.25) is None
    assert done.latency_s == pytest.approx(0.2)


def test_a_confirmed_stop_is_over_once_comm_says_so_and_not_while_it_was_just_started_and_does_not_know() -> None:
    done = updated(pressed(IDLE, 10.0, 7), STOPPED, 10.25)
    assert updated(done, with_permit(RELEASED, stop_epoch=0), 10.45) == done
    assert updated(done, RELEASED, 10.45).latency_s is None


def test_to_press_again_changes_nothing_while_it_is_sent_and_is_a_press_of_its_own_afterwards() -> None:
    control = pressed(IDLE, 10.0, 7)
    assert pressed(control, 10.1, 8) is control
    done = updated(control, STOPPED, 10.25)
    again = pressed(done, 10.3, 9)
    assert (again.demand, again.stop_id) == (Demand.STOP, 9)
    assert look(again, STOPPED, 10.3) is Look.SENT


def test_a_press_without_a_link_is_sent_even_when_a_stop_was_latched_before() -> None:
    done = updated(pressed(IDLE, 10.0, 7), STOPPED, 10.25)
    later_s = 10.25 + LINK_LOST_S + 1.0
    again = pressed(done, later_s, 8)
    assert request(again, later_s) is not None
    assert look(again, STOPPED, later_s) is Look.LINK_LOST


def test_a_stop_of_another_source_is_not_the_press() -> None:
    button = with_permit(STOPPED, stop_sources=("button",), stop_ids=(99,))
    assert look(IDLE, button, 10.2) is Look.LATCHED
    control = pressed(IDLE, 10.2, 8)
    assert updated(control, replace(button, odometry_s=10.4), 10.4).demand is Demand.STOP
    both = replace(with_permit(button, stop_ids=(99, 8), stop_epoch=6), odometry_s=10.4, board_epoch=6)
    assert updated(control, both, 10.4).demand is Demand.NONE


@pytest.mark.parametrize(
    ("control", "report", "now_s", "said"),
    [
        (IDLE, STOPPED, 20.0, "No message"),
        (StopControl(Demand.STOP, 10.0), STOPPED, 10.3, "not confirmed yet"),
        (IDLE, replace(STOPPED, button_pressed=True), 10.3, "button"),
        (IDLE, with_permit(STOPPED, stop_epoch=0), 10.3, "Arduino"),
        (IDLE, DRIVING, 10.0, "No stop"),
    ],
)
def test_a_release_is_hindered_with_a_reason(
    control: StopControl, report: RobotReport, now_s: float, said: str
) -> None:
    assert said in release_hindrance(control, report, now_s)
    assert release_requested(control, report, now_s) is control


def test_a_release_names_the_stop_that_was_seen_and_ends_with_the_robots_word() -> None:
    control = release_requested(IDLE, STOPPED, 10.3)
    sent = request(control, 10.3)
    assert sent is not None
    assert (sent.latched, sent.epoch) == (False, 5)
    assert updated(control, replace(STOPPED, permit_s=10.4), 10.4) is control
    assert updated(control, RELEASED, 10.4) == IDLE
    assert look(IDLE, RELEASED, 10.4) is Look.RELEASED
    assert "before a resume" in bar_text(Snapshot(10.4, report=RELEASED)).headline


@pytest.mark.parametrize(
    ("report", "now_s"),
    [(STOPPED, 10.3 + RELEASE_TIMEOUT_S + 0.1), (with_permit(STOPPED, stop_epoch=6), 10.4)],
    ids=["no answer", "somebody stopped it again"],
)
def test_a_release_that_failed_is_told(report: RobotReport, now_s: float) -> None:
    failed = updated(release_requested(IDLE, STOPPED, 10.3), replace(report, permit_s=now_s), now_s)
    assert (failed.demand, failed.release_failed) == (Demand.NONE, True)


def test_a_press_ends_a_release_at_once() -> None:
    control = release_requested(IDLE, STOPPED, 10.3)
    assert pressed(control, 10.35, 8).demand is Demand.STOP


REPORTS = st.builds(
    RobotReport,
    st.sets(st.sampled_from([SOURCE, "hardware_button"])).map(
        lambda s: replace(LATCHED, stop_sources=tuple(sorted(s)))
    ),
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
    if shown in (Look.LATCHED, Look.IDLE, Look.RELEASED, Look.UNKNOWN):
        assert now_s - report.permit_s <= LINK_LOST_S
        assert (shown is Look.LATCHED) == bool(report.permit.stop_sources)
    text = bar_text(Snapshot(now_s, control=control, report=report))
    assert ("robot confirmed" in text.headline) <= (shown is Look.LATCHED)
    assert text.headline


def test_wheels_that_turn_under_a_latched_stop_are_told() -> None:
    turning = replace(STOPPED, standing=False, speed_m_s=0.12)
    text = bar_text(Snapshot(10.3, report=turning))
    assert text.headline == "LATCHED – wheels turn, speed 0.12"
    assert "red button" in text.detail


def test_a_release_from_afar_counts_for_the_stop_that_was_seen_and_for_no_newer_one() -> None:
    desk = StopDesk(lambda: 10.3)
    desk.receive(STOPPED, 10.3)
    desk.release(4)
    assert desk.control.demand is Demand.NONE, "somebody pressed since"
    desk.release(5)
    assert desk.control.demand is Demand.RELEASE
    assert desk.control.epoch == 5
