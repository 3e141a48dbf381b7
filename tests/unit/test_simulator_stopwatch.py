"""Wall time is always on one account: together they are the whole, however the work is nested."""

from __future__ import annotations

import time

import pytest

from offboard.simulator import stopwatch as module
from offboard.simulator.stopwatch import BUS, REST, Stopwatch


@pytest.fixture
def passed_s(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """What the clock shows; a test lets time pass by changing it."""
    now_s = [0.0]
    monkeypatch.setattr(module.time, "perf_counter", lambda: now_s[0])
    return now_s


def test_work_inside_other_work_has_its_own_account_and_the_other_goes_on(passed_s: list[float]) -> None:
    watch = Stopwatch()
    passed_s[0] = 1.0
    watch.enter("mmu")
    passed_s[0] = 3.0
    before = watch.enter(BUS)
    passed_s[0] = 7.0
    watch.enter(before)
    passed_s[0] = 15.0
    watch.enter(REST)
    passed_s[0] = 31.0
    assert watch.spent_s() == {REST: 17.0, "mmu": 10.0, BUS: 4.0}


def test_a_part_can_be_booked_on_another_account_and_a_restart_forgets(passed_s: list[float]) -> None:
    watch = Stopwatch()
    watch.enter("physics")
    passed_s[0] = 5.0
    watch.move("physics", "IMU", 2.0)
    assert watch.spent_s() == {REST: 0.0, "physics": 3.0, "IMU": 2.0}
    watch.restart()
    passed_s[0] = 6.0
    assert watch.spent_s() == {REST: 1.0}


def test_accounts_add_up_to_the_whole() -> None:
    began_s = time.perf_counter()
    watch = Stopwatch()
    for account in ("bridge", BUS, "bridge", REST) * 100:
        watch.enter(account)
    assert sum(watch.spent_s().values()) == pytest.approx(time.perf_counter() - began_s, abs=0.01)
