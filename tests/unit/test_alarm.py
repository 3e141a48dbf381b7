"""What a loop sleeps on: no message is slept through, and none keeps the loop awake once it was taken."""

from __future__ import annotations

import os
import threading
import time

import pytest

from common.alarm import Alarm
from common.clock import FreeClock

LONG_S = 5.0


class OneStep:
    """A schedule of a node that is due when its message has come, or after LONG_S."""

    def __init__(self, alarm: Alarm) -> None:
        self._alarm = alarm
        self.due_s = time.monotonic() + LONG_S

    def fileno(self) -> int | None:
        return None

    def file_has(self, now_s: float) -> None:
        raise AssertionError("there is no file")

    def receive(self) -> None:
        self.due_s = time.monotonic()
        self._alarm.ring()


def seconds_until_step(alarm: Alarm, arrives_after_s: float) -> float:
    schedule = OneStep(alarm)
    arrival = threading.Timer(arrives_after_s, schedule.receive)
    arrival.start()
    began_s = time.monotonic()
    FreeClock().wait(schedule, alarm, threading.Event())
    arrival.join()
    return time.monotonic() - began_s


def test_a_message_ends_the_sleep() -> None:
    assert seconds_until_step(Alarm(), 0.1) < LONG_S / 2


def test_a_ring_for_a_message_that_was_taken_already_makes_no_loop_deaf_for_the_next() -> None:
    alarm = Alarm()
    alarm.ring()  # by a node of the same loop, for one that was stepped after it in the same pass
    assert seconds_until_step(alarm, 0.1) < LONG_S / 2


def test_who_rings_and_is_held_up_meanwhile_keeps_no_loop_awake(monkeypatch: pytest.MonkeyPatch) -> None:
    alarm = Alarm()
    write = os.eventfd_write

    def write_late(descriptor: int, count: int) -> None:
        alarm.reset()  # the loop was awake for something else, and has taken the message as well
        write(descriptor, count)

    monkeypatch.setattr(os, "eventfd_write", write_late)
    alarm.ring()
    alarm.wait(0.05)
    began_s = time.monotonic()
    alarm.wait(0.2)
    assert time.monotonic() - began_s >= 0.19
