"""Whatever can be decoded, and whatever only looks as if it could, comes to every node on all of its topics."""

from __future__ import annotations

import pytest

from tests.fuzz.nodes import STAGES
from tests.fuzz.storm import Outcome, storm
from tests.fuzz.wild import UNLIMITED

STEP_MAX_MS = 100.0
GROWN_MAX_MB = 50.0


def weathered(name: str, count: int) -> Outcome:
    """The outcome; once more where a busy machine may have made a step long."""
    outcome = storm(name, count, seed=1)
    return storm(name, count, seed=1) if outcome.longest_step_ms > STEP_MAX_MS else outcome


def check(outcome: Outcome) -> None:
    assert not outcome.trouble, outcome.trouble
    assert outcome.refused
    assert outcome.longest_step_ms < STEP_MAX_MS
    assert outcome.grown_mb < GROWN_MAX_MB
    assert not outcome.motors_started


@pytest.mark.parametrize("name", STAGES)
def test_no_message_ends_delays_or_bloats_a_node_or_starts_a_motor(name: str) -> None:
    check(weathered(name, 1_500))


@pytest.mark.parametrize("name", ["comm", "recorder"])
def test_storing_the_longest_messages_that_the_codec_accepts_delays_no_step(name: str) -> None:
    outcome = storm(name, 300, seed=1, longest=UNLIMITED)
    assert not outcome.trouble, outcome.trouble
    assert outcome.longest_step_ms < STEP_MAX_MS


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", STAGES)
def test_a_million_messages_end_delay_or_bloat_no_node_and_start_no_motor(name: str) -> None:
    outcome = weathered(name, 125_000)
    print(name, outcome)
    check(outcome)
