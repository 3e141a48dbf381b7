"""How the mission stands, in the same words everywhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from common.messages.mission import Operation, Outcome, PlannerView
from common.messages.stop import Permit
from common.mission_state import (
    ENDED,
    NOT_PAUSED,
    STARTED_ALREADY,
    STILL_PAUSED,
    Stage,
    effect,
    hindrance,
    is_stopped,
    mission_state,
    started,
)
from offboard.evaluate.run_text import progress
from onboard.planner.mission.table import AT_REST, BLOCKED, EXPLORING, GOING_HOME, Mode, State

FREE = Permit(0.0, True, "", stop_epoch=3)
LATCHED = Permit(0.0, False, "stopped by operator", ("operator",), stop_epoch=4, resumed=False)
RELEASED = Permit(0.0, False, "released, waiting for a resume", stop_epoch=4, resumed=False)
NOWHERE = np.zeros((0, 2), np.float32)


def view(mode: Mode, outcome: Outcome = Outcome.NONE, *, halls: int = 3, paused: bool = False) -> PlannerView:
    """As the planner publishes it."""
    return PlannerView(0.0, mode.name, State(mode, outcome).text, NOWHERE, halls, 42.0, outcome, paused=paused)


DRIVING = view(Mode.ROUTE)


def test_a_paused_robot_is_paused_and_may_not_move() -> None:
    state = mission_state(view(Mode.ROUTE, paused=True), FREE)
    assert state.text == "paused while driving to a side hall"
    assert state.standing == "paused"
    assert mission_state(DRIVING, FREE).standing == ""
    assert mission_state(view(Mode.WAITING, paused=True), FREE).text == "paused; waiting for start"


def test_a_stop_comes_first_and_lasts_until_it_is_resumed() -> None:
    assert mission_state(DRIVING, LATCHED).text == "stopped while driving to a side hall"
    assert mission_state(DRIVING, LATCHED).standing == "stopped by operator"
    assert (
        mission_state(view(Mode.ROUTE, paused=True), RELEASED).text == "stopped and paused while driving to a side hall"
    )
    assert mission_state(DRIVING, RELEASED).standing == "released, waiting for a resume"
    assert not is_stopped(FREE)


def test_each_end_has_words_of_its_own_and_only_a_finished_exploration_is_done() -> None:
    states = {outcome: mission_state(view(Mode.DONE, outcome), FREE) for outcome in ENDED}
    assert {outcome: state.text for outcome, state in states.items()} == ENDED
    assert [outcome for outcome, state in states.items() if state.stage is Stage.DONE] == [Outcome.FINISHED]
    assert {state.halls for state in states.values()} == {"3 not visited"}
    assert mission_state(DRIVING, FREE).halls == "3 to visit"
    assert all(state.standing == state.text for state in states.values())


@pytest.mark.parametrize("mode", Mode)
def test_every_mode_of_the_table_is_of_the_right_stage(mode: Mode) -> None:
    stage = mission_state(view(mode, Outcome.ARRIVED if mode is Mode.DONE else Outcome.NONE), FREE).stage
    wanted = {
        Stage.WAIT: (Mode.WAITING,),
        Stage.EXPLORE: (*EXPLORING, Mode.RETAKE),
        Stage.RETURN: GOING_HOME,
        Stage.ELSEWHERE: (Mode.GOTO, Mode.GOTO_BLOCKED, Mode.DONE),
    }
    assert mode in wanted[stage]
    assert started(view(mode)) is (mode is not Mode.WAITING)
    assert bool(mission_state(view(mode), FREE).standing) is (mode in (*AT_REST, *BLOCKED))


def test_what_is_not_known_is_no_motion() -> None:
    assert mission_state(None, FREE).text == "waiting for the planner"
    assert mission_state(None, FREE).standing
    assert mission_state(DRIVING, None).standing == "no permit was received"
    assert mission_state(DRIVING, replace(FREE, granted=False, reason="mmu is silent")).standing == "mmu is silent"


@pytest.mark.parametrize("operation", [Operation.START, Operation.HOME, Operation.GOTO, Operation.RESUME])
def test_what_is_promised_of_a_command_is_what_will_happen(operation: Operation) -> None:
    waiting = view(Mode.WAITING)
    if operation is Operation.RESUME:
        assert effect(operation, DRIVING, RELEASED) == "The robot goes on where it was stopped."
        assert effect(operation, view(Mode.ROUTE, paused=True), FREE) == "The robot goes on where it was paused."
        assert STILL_PAUSED in effect(operation, view(Mode.ROUTE, paused=True), RELEASED)
        assert effect(operation, DRIVING, FREE) == NOT_PAUSED
    else:
        assert "nothing moves" not in effect(operation, waiting, FREE)
        assert "nothing moves before its release and a resume" in effect(operation, waiting, LATCHED)
        assert "nothing moves before a resume" in effect(operation, waiting, RELEASED)
        assert "mmu is silent" in effect(operation, waiting, replace(FREE, granted=False, reason="mmu is silent"))
        assert "nothing is received" in effect(operation, waiting, None)


def test_what_would_change_nothing_is_known_before_it_is_sent() -> None:
    assert hindrance(Operation.RESUME, DRIVING, FREE) == NOT_PAUSED
    assert "release the stop first" in hindrance(Operation.RESUME, DRIVING, LATCHED)
    assert hindrance(Operation.RESUME, DRIVING, RELEASED) == ""
    assert hindrance(Operation.RESUME, view(Mode.ROUTE, paused=True), FREE) == ""
    assert hindrance(Operation.START, DRIVING, FREE) == STARTED_ALREADY
    assert hindrance(Operation.START, view(Mode.DONE, Outcome.ARRIVED), FREE) == ""
    assert hindrance(Operation.START, None, FREE) == ""


def test_a_headless_run_prints_the_same_words() -> None:
    assert "paused while driving to a side hall" in progress(12.0, view(Mode.ROUTE, paused=True), FREE)
    line = progress(12.0, DRIVING, LATCHED)
    assert "stopped while driving to a side hall, standing: stopped by operator" in line
