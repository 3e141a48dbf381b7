"""Answers to questions: as many bytes a second as there may be, whoever asks and however often."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from common.reply_budget import ANSWER_BYTES_MIN, BURST_BYTES, RATE_BYTES_S, ReplyBudget


@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.integers(0, 1_000_000)), max_size=200))
def test_no_more_goes_out_than_the_burst_and_the_rate(questions: list[tuple[float, int]]) -> None:
    budget, now_s, said_bytes, count = ReplyBudget(), 0.0, 0, 0
    for pause_s, answer_bytes in questions:
        now_s += pause_s
        if budget.allows(answer_bytes, now_s):
            said_bytes, count = said_bytes + answer_bytes, count + 1
    allowed_bytes = BURST_BYTES + RATE_BYTES_S * now_s + 1.0
    assert said_bytes <= allowed_bytes
    assert count <= allowed_bytes / ANSWER_BYTES_MIN


def test_who_asks_now_and_then_is_always_answered() -> None:
    budget = ReplyBudget()
    assert all(budget.allows(RATE_BYTES_S, float(now_s)) for now_s in range(60))


def test_what_is_longer_than_a_burst_is_answered_once_nothing_else_was() -> None:
    budget = ReplyBudget()
    assert budget.allows(3 * BURST_BYTES, 0.0)
    assert not budget.allows(1, 1.0)
    assert not budget.allows(3 * BURST_BYTES, 3.0 * BURST_BYTES / RATE_BYTES_S - 0.1)
    assert budget.allows(3 * BURST_BYTES, 3.0 * BURST_BYTES / RATE_BYTES_S + 0.1)
