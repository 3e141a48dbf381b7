"""What Zenoh says of refusals becomes lines for people: each once, with who it was; the rest stays away."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.repeats import Repeats
from common.zenoh_log import ZenohLog

RULES = "2026-11-27T04:45:30.1Z {level} rx-1 ThreadId(0{thread}) zenoh::net::routing::interceptor::access_control: "
VIEWER = "a1b2"
CLOCKS = (
    "2026-11-30T19:50:{:02}.675914Z ERROR ThreadId(01) zenoh::net::routing::dispatcher::pubsub: Error treating "
    "timestamp for received Data (incoming timestamp from 34820ca4c75f48724e04031762fc1251 exceeding delta 500ms is "
    "rejected: 2026-11-30T19:50:32.675763000Z vs. now: 2026-11-30T19:50:22.675885447Z). "
    "Replace timestamp: Some(7714054277777803232/34820ca4c75f48724e04031762fc1251)\n"
)
KNOWN_AS = f" on Interface(lo)+CertCommonName(viewer)+Transport(Tls)+{VIEWER}"
WRITTEN = ("Reply", "Put", "Delete", "Declare/Undeclare Subscriber")


def judged(act: str, key: str, verdict: str = "unauthorized", subject: str = KNOWN_AS, thread: int = 8) -> str:
    """A line of Zenoh about what somebody sends; without a subject, of a right that it had worked out before."""
    cached = "" if subject else "Using cached result: "
    said = f"{cached}{VIEWER}{subject} is {verdict} to {act} (ingress) on robot1/{key}\n"
    return RULES.format(level="TRACE", thread=thread) + said


def told(caplog: pytest.LogCaptureFixture, *pieces: str, now_s: float = 0.0) -> list[str]:
    log = ZenohLog()
    for piece in pieces:
        log.receive(piece, now_s)
    return caplog.messages


def test_a_refused_message_is_told_with_who_said_it_and_on_what(caplog: pytest.LogCaptureFixture) -> None:
    lines = told(caplog, judged("Put", "planner/drive"), judged("Put", "planner/drive"), judged("Put", "no/topic"))
    assert [line.split("right to it ")[1] for line in lines] == [
        "certificate=viewer topic=planner/drive count=1",
        "certificate=viewer topic=other count=1",
    ]


def test_rights_that_are_worked_out_are_no_refusal_but_what_is_said_then_is(caplog: pytest.LogCaptureFixture) -> None:
    rights = "".join(judged(act, "comm/permit") for act in WRITTEN)
    assert told(caplog, rights, judged("Put", "comm/permit", "authorized")) == []
    assert len(told(caplog, rights, judged("Put", "comm/permit", subject=""))) == 1


def test_what_two_threads_say_is_told_apart(caplog: pytest.LogCaptureFixture) -> None:
    begun, ended = judged("Reply", "comm/permit"), judged("Put", "comm/permit")
    assert len(told(caplog, begun, judged("Put", "comm/permit", thread=9), ended)) == 1


def test_coloured_errors_and_warnings_are_told_with_their_level(caplog: pytest.LogCaptureFixture) -> None:
    source = "\x1b[2mzenoh_link_tls::unicast\x1b[0m\x1b[2m:\x1b[0m"
    line = f"\x1b[2m2026Z\x1b[0m \x1b[33m WARN\x1b[0m acc-0 ThreadId(04) {source} {{}}\n"
    told(caplog, line.format("peer sent no certificates at /build/tls.rs:1."), line.format("invalid peer certificate"))
    assert [(record.levelname, record.getMessage()) for record in caplog.records] == [
        ("WARNING", "zenoh_link_tls: peer sent no certificates count=1"),
        ("WARNING", "zenoh_link_tls: invalid peer certificate count=1"),
    ]


def test_clocks_that_are_apart_are_one_warning_and_no_error_a_second(caplog: pytest.LogCaptureFixture) -> None:
    log = ZenohLog()
    for second in range(4000):
        log.receive(CLOCKS.format(second % 60), float(second))
    assert [record.levelname for record in caplog.records] == ["WARNING", "WARNING"], "one an hour"
    assert "clock of another machine is ahead" in caplog.messages[0]


def test_lines_may_be_cut_anywhere(caplog: pytest.LogCaptureFixture) -> None:
    text = judged("Put", "comm/permit") + judged("Put", "planner/drive")
    for cut in range(len(text)):
        assert len(told(caplog, text[:cut], text[cut:])) == 2
        caplog.clear()


@given(text=st.text())
def test_whatever_is_written_there_does_no_harm(text: str) -> None:
    ZenohLog().receive(text + "\n", 0.0)


def test_the_same_complaint_is_due_once_a_second_with_all_that_came() -> None:
    repeats = Repeats()
    assert [repeats.count("a", now_s) for now_s in (0.0, 0.4, 0.9, 1.0, 1.5, 2.5)] == [1, 0, 0, 4, 0, 6]
    assert repeats.count("b", 2.5) == 1


def test_ever_new_complaints_do_not_fill_the_memory() -> None:
    repeats = Repeats()
    assert all(repeats.count(str(k), 0.0) == 1 for k in range(10_000))
    assert repeats.count("0", 0.0) == 1
