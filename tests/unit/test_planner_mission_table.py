"""The mission's table: every mode with every event, paused and not."""

from __future__ import annotations

from itertools import product

import pytest

from common.messages.mission import Operation, OperatorCommand, Outcome
from common.messages.stop import Permit
from common.mission_state import NOT_PAUSED, STILL_PAUSED, is_stopped
from onboard.planner.mission.orders import Orders
from onboard.planner.mission.table import (
    AT_REST,
    EXPLORING,
    GOING_HOME,
    ROW_OF,
    TABLE,
    Event,
    Mode,
    State,
    Step,
    after,
)

AIMS = {Mode.WAITING: Outcome.NONE, Mode.GOTO: Outcome.ARRIVED, Mode.GOTO_BLOCKED: Outcome.ARRIVED}
ALL = [
    (State(mode, aim=AIMS.get(mode, Outcome.FINISHED), paused=paused), event)
    for mode, event, paused in product(Mode, Event, (False, True))
]
ORDERS_TO_DRIVE = (Event.START, Event.GO_HOME, Event.GO_TO)


def run(*events: Event) -> State:
    state = State()
    for event in events:
        state = after(state, event).state
    return state


def test_no_mode_and_event_stands_in_two_rows() -> None:
    assert len(ROW_OF) == sum(len(row.modes) for row in TABLE)


def test_every_event_and_every_mode_is_in_the_table() -> None:
    assert {event for _, event in ROW_OF} == set(Event)
    assert {mode for mode, _ in ROW_OF} == set(Mode)
    assert {row.to for row in TABLE} - {None} == set(Mode) - {Mode.WAITING}


def test_every_step_is_what_its_row_says_and_all_else_changes_nothing() -> None:
    for state, event in ALL:
        step, row = after(state, event), ROW_OF.get((state.mode, event))
        if row is None or step.refused:
            assert step.state == state, (state, event)
        else:
            assert step.state.mode is (row.to or state.mode), (state, event)
            assert step.moves is (row.to is not None)


def test_a_refusal_has_a_sentence_and_is_of_an_operator() -> None:
    for state, event in ALL:
        step = after(state, event)
        if step.refused:
            assert event in (Event.START, Event.RESUME, Event.GO_NOWHERE, Event.GO_FORBIDDEN)
            assert step.note.endswith(".")


def test_goto_ends_in_arrived_and_never_in_finished() -> None:
    ends = {row.event for row in TABLE if Mode.GOTO in row.modes and row.to is Mode.DONE}
    assert ends == {Event.ARRIVED}
    for mode in Mode:
        going = after(State(mode, aim=Outcome.FINISHED), Event.GO_TO).state
        assert (going.mode, going.outcome) == (Mode.GOTO, Outcome.NONE)
        assert after(going, Event.ARRIVED).state.outcome is Outcome.ARRIVED


def test_who_arrived_at_a_place_or_stands_stopped_goes_on_and_no_headless_run_ends_with_it() -> None:
    assert [outcome for outcome in Outcome if not outcome.ends_mission] == [
        Outcome.NONE,
        Outcome.ARRIVED,
        Outcome.STOPPED,
    ]


def test_only_an_exploration_that_left_nothing_out_is_finished() -> None:
    explored = (Event.START, Event.AHEAD, Event.LEG_OVER, Event.EXPLORED, Event.ARRIVED, Event.ALIGNED)
    assert run(*explored) == State(Mode.DONE, Outcome.FINISHED, Outcome.FINISHED)
    assert run(Event.START, Event.AHEAD, Event.GO_HOME, Event.ARRIVED, Event.ALIGNED).outcome is Outcome.HOME
    assert run(*explored[:4], Event.GO_HOME, Event.ARRIVED, Event.ALIGNED).outcome is Outcome.FINISHED
    for state, event in ALL:
        if after(state, event).state.outcome is Outcome.FINISHED:
            assert (state.mode, event) == (Mode.ALIGN, Event.ALIGNED)


def test_a_place_without_a_path_is_tried_again_until_it_is_given_up() -> None:
    blocked = (Event.GO_TO, Event.NO_PATH)
    assert run(*blocked).mode is Mode.GOTO_BLOCKED
    assert run(*blocked, Event.PATH, Event.ARRIVED).outcome is Outcome.ARRIVED
    assert run(*blocked, Event.TOO_LONG) == State(Mode.DONE, Outcome.GAVE_UP, Outcome.ARRIVED)
    assert run(*blocked, Event.KEPT_OUT) == State(Mode.DONE, Outcome.GAVE_UP, Outcome.ARRIVED)
    assert run(*blocked, Event.TOO_LONG, Event.START).mode is Mode.LOOK


def test_who_finds_no_way_home_asks_for_help_and_can_be_sent_home_again() -> None:
    stuck = (Event.START, Event.GO_HOME, Event.NO_PATH, Event.TOO_LONG)
    assert run(*stuck) == State(Mode.DONE, Outcome.NEEDS_HELP, Outcome.HOME)
    assert run(*stuck[:3], Event.KEPT_OUT) == run(*stuck)
    assert run(*stuck[:2]).outcome.ends_mission is False
    assert run(*stuck).outcome.ends_mission
    assert run(*stuck).outcome.exit_code not in {
        outcome.exit_code for outcome in Outcome if outcome is not run(*stuck).outcome
    }
    assert run(*stuck, Event.GO_HOME).mode is Mode.HOME


def test_start_begins_from_rest_only() -> None:
    for state, event in ALL:
        if event is Event.START:
            assert after(state, event).refused is (state.mode not in AT_REST)


def test_nothing_but_an_order_to_drive_leaves_rest() -> None:
    for state, event in ALL:
        if state.mode in AT_REST and event not in ORDERS_TO_DRIVE:
            assert after(state, event).state.mode is state.mode


def test_another_photo_interrupts_exploring_and_nothing_else() -> None:
    for state, event in ALL:
        if event is Event.DETOUR:
            assert (after(state, event).state.mode is Mode.RETAKE) is (state.mode in (*EXPLORING, Mode.RETAKE))


def test_a_pause_keeps_the_mode_and_ends_with_resume_or_an_order_to_drive() -> None:
    for state, event in ALL:
        step = after(state, event)
        if event is Event.PAUSE:
            assert step.state.paused
            assert step.state.mode is state.mode
        elif state.paused:
            ends = event is Event.RESUME or (event in ORDERS_TO_DRIVE and not step.refused)
            assert step.state.paused is not ends, (state, event)
        else:
            assert not step.state.paused


def test_a_resume_ends_one_thing_the_stop_before_the_pause() -> None:
    paused = run(Event.START, Event.PAUSE, Event.STOPPED)
    assert (paused.mode, paused.outcome) == (Mode.LOOK, Outcome.STOPPED)
    resumed = after(paused, Event.RESUME_STOP)
    assert resumed.state.paused
    assert resumed.note == STILL_PAUSED
    assert after(resumed.state, Event.STOP_OVER).state.outcome is Outcome.NONE
    assert not after(resumed.state, Event.RESUME).state.paused
    assert after(run(Event.START), Event.RESUME) == Step(run(Event.START), refused=True, note=NOT_PAUSED)


def test_home_is_home_from_everywhere() -> None:
    for state, event in ALL:
        if event is Event.GO_HOME:
            aim = after(state, event).state.aim
            assert after(state, event).state.mode is Mode.HOME
            assert aim is (state.aim if state.mode in GOING_HOME else Outcome.HOME)


def permit(epoch: int, *, sources: tuple[str, ...] = (), resumed: bool = True) -> Permit:
    return Permit(0.0, not sources and resumed, "", sources, stop_epoch=epoch, resumed=resumed)


def order(orders: Orders, operation: Operation, said: Permit, command_id: int, epoch: int = 0) -> Event | None:
    command = OperatorCommand(0.0, operation, command_id=command_id, epoch=epoch)
    event = orders.event_of(command, said)
    if event is not None:
        orders.answered(command, said, Step(State(), refused=event is Event.RESUME, note="n"))
    return event


def test_a_resume_means_the_stop_first_and_a_pause_after_that() -> None:
    orders = Orders()
    order(orders, Operation.START, permit(3), 1)
    assert order(orders, Operation.RESUME, permit(3), 2, epoch=3) is Event.RESUME
    assert order(orders, Operation.RESUME, permit(4, sources=("operator",)), 3, epoch=4) is None, "not released"
    assert order(orders, Operation.RESUME, permit(4, resumed=False), 3, epoch=3) is None, "an earlier stop"
    assert order(orders, Operation.RESUME, permit(4, resumed=False), 3, epoch=4) is Event.RESUME_STOP
    assert order(orders, Operation.RESUME, permit(4), 4, epoch=4) is Event.RESUME


def test_a_resume_that_comm_took_first_still_means_the_stop() -> None:
    orders = Orders()
    order(orders, Operation.PAUSE, permit(3), 1)
    assert order(orders, Operation.RESUME, permit(4), 2, epoch=4) is Event.RESUME_STOP


def test_a_pause_that_was_given_after_the_resume_is_ended_by_the_next_one() -> None:
    orders = Orders()
    order(orders, Operation.PAUSE, permit(4), 1)
    assert order(orders, Operation.RESUME, permit(4), 2, epoch=4) is Event.RESUME


def test_the_newest_command_is_answered_and_its_repeats_are_known() -> None:
    orders = Orders()
    command = OperatorCommand(0.0, Operation.PAUSE, command_id=7)
    assert not orders.is_repeat(command)
    orders.answered(command, None, Step(State(), refused=True, note="No."))
    assert (orders.answer.command_id, orders.answer.refused, orders.answer.note) == (7, True, "No.")
    assert orders.is_repeat(command)
    assert not orders.is_repeat(OperatorCommand(0.0, Operation.PAUSE))


@pytest.mark.parametrize(
    ("said", "stopped"),
    [
        (permit(1, sources=("operator",)), True),
        (permit(1, resumed=False), True),
        (permit(1), False),
    ],
)
def test_a_stop_lasts_until_it_is_resumed(said: Permit, stopped: bool) -> None:
    assert is_stopped(said) is stopped
