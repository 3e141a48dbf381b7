"""The log as the Command Center keeps it."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from offboard.command_center.log_book import LEVELS, MESSAGE_LEVEL, LogBook, LogEntry, LogFilter


def entry(message: str, level: str = "INFO", module: str = "mmu", at_s: float = 0.0) -> LogEntry:
    topic = f"{module}/{'pose' if level == MESSAGE_LEVEL else 'log'}"
    return LogEntry(at_s, module, topic, level, f"X_CC_0_{message}", message)


def shown(book: LogBook) -> list[str]:
    return [e.message for e in book.shown]


def test_repeats_of_one_module_collapse_whatever_the_others_say_meanwhile() -> None:
    book = LogBook()
    book.add([entry("late"), entry("state", module="planner"), entry("late", at_s=1.0), entry("late", at_s=2.0)])
    assert [(e.message, e.count) for e in book.shown] == [("late", 3), ("state", 1)]


def test_a_line_that_comes_again_much_later_is_a_new_one() -> None:
    book = LogBook()
    book.add([entry("late"), entry("late", at_s=60.0)])
    assert shown(book) == ["late", "late"]


def test_filters_join() -> None:
    book = LogBook()
    book.add([entry("a", "DEBUG"), entry("b"), entry("c", "ERROR"), entry("d", "ERROR", "planner")])
    assert shown(book) == ["b", "c", "d"]
    book.set_filter(LogFilter("ERROR"))
    assert shown(book) == ["c", "d"]
    book.set_filter(LogFilter("ERROR", "planner"))
    assert shown(book) == ["d"]
    book.set_filter(LogFilter("DEBUG", pattern="_[ab]$"))
    assert shown(book) == ["a", "b"]
    assert (len(book.shown), book.total) == (2, 4)


def test_messages_pass_by_their_topic_and_never_by_level() -> None:
    book = LogBook(filter=LogFilter("ERROR"))
    book.add([entry("pose", MESSAGE_LEVEL)])
    assert shown(book) == []
    book.set_filter(LogFilter("ERROR", topics=frozenset({"mmu/pose"})))
    assert shown(book) == ["pose"]


def test_a_pattern_that_is_none_leaves_the_filter_as_it_is() -> None:
    book = LogBook()
    book.add([entry("a")])
    with pytest.raises(re.error):
        book.set_filter(LogFilter(pattern="("))
    assert shown(book) == ["a"]


@given(st.lists(st.tuples(st.integers(0, 30), st.sampled_from(LEVELS)), max_size=60), st.integers(1, 12))
def test_the_book_is_bounded_and_shows_what_it_holds(lines: list[tuple[int, str]], capacity: int) -> None:
    book = LogBook(capacity, LogFilter("WARNING"))
    held = 0
    for number, (text, level) in enumerate(lines):
        before = len(book.shown)
        fallen = book.add([entry(f"{number} {text}", level)])
        held = before - fallen + (LEVELS.index(level) >= LEVELS.index("WARNING"))
        assert len(book.shown) == held
        assert book.total <= capacity
    expected = [f"{n} {t}" for n, (t, lv) in enumerate(lines) if LEVELS.index(lv) >= 2 and n >= len(lines) - capacity]
    assert shown(book) == expected


def test_long_lines_fill_the_book_as_many_short_ones_do() -> None:
    book = LogBook()
    book.add(entry("x" * 1000 + str(number)) for number in range(8_000))
    assert 4_000 < book.total == len(book.shown) < 5_000
    assert book.shown[-1].message.endswith("7999")
