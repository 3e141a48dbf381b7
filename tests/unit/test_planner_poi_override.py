"""Table P2.0 as the Planner keeps it."""

import pytest

from common.messages.motion import Speed
from common.messages.points_of_interest import PoiCommand
from onboard.planner.driving.poi_override import HOLD_MAX_S, Override, after, speed


@pytest.mark.requirement("POI_MR_05")
@pytest.mark.parametrize(
    ("command", "expected"),
    [(PoiCommand.STOP, Speed.STOP), (PoiCommand.REVERSE, Speed.REVERSE), (PoiCommand.CONTINUE, None)],
)
def test_a_request_is_obeyed_until_the_next_one(command: PoiCommand, expected: Speed | None) -> None:
    state = after(Override(), command, 10.0, turning=False)
    assert speed(state, 10.5) is expected
    assert speed(after(state, PoiCommand.CONTINUE, 11.0, turning=False), 11.5) is None


def test_a_request_while_the_carrier_turns_is_ignored() -> None:
    assert after(Override(), PoiCommand.STOP, 10.0, turning=True) == Override()


def test_a_repeated_request_does_not_begin_anew() -> None:
    state = after(Override(), PoiCommand.REVERSE, 10.0, turning=False)
    assert after(state, PoiCommand.REVERSE, 12.0, turning=False).since_s == 10.0


@pytest.mark.parametrize("command", [PoiCommand.STOP, PoiCommand.REVERSE])
def test_a_hold_that_nobody_ends_ends_by_itself(command: PoiCommand) -> None:
    state = after(Override(), command, 10.0, turning=False)
    assert speed(state, 10.0 + HOLD_MAX_S + 0.1) is None
