"""The shared clock: who holds it, for how long, and who cannot."""

from __future__ import annotations

import threading

import pytest

from common.clock import SILENT_S, TICK_S, WINDOW_S, Announcements, FollowerClock, FollowerTable, LeaderClock


def test_a_late_follower_holds_the_clock_after_the_window() -> None:
    table = FollowerTable()
    table.receive_ack("mmu", 1.0)
    assert not table.holds(1.0 + WINDOW_S, wall_s=10.0)
    assert table.holds(1.0 + WINDOW_S + 0.001, wall_s=10.0)
    assert WINDOW_S <= 0.1


def test_a_silent_follower_is_dropped_until_it_speaks_again() -> None:
    table = FollowerTable()
    table.receive_ack("mmu", 1.0)
    assert table.holds(1.2, wall_s=10.0)
    assert table.holds(1.2, wall_s=10.0 + SILENT_S - 0.01)
    assert not table.holds(1.2, wall_s=10.0 + SILENT_S)
    assert not table.holds(5.0, wall_s=20.0)
    table.receive_ack("mmu", 5.0)
    assert table.holds(5.2, wall_s=20.0)


def test_a_follower_with_a_long_period_is_not_silent_before_it_owes_an_answer() -> None:
    table = FollowerTable()
    table.receive_ack("recorder", 1.0)
    assert not table.holds(1.0, wall_s=100.0)
    assert table.holds(1.1, wall_s=100.0)


def test_nobody_holds_a_clock_without_followers() -> None:
    assert not FollowerTable().holds(1e6, 0.0)


@pytest.mark.timeout(20)
def test_leader_and_follower_step_to_the_same_time() -> None:
    stop = threading.Event()
    leader, follower = LeaderClock(speed=1000.0), FollowerClock()
    ticks: list[float] = []

    def send_tick(t_s: float) -> None:
        ticks.append(t_s)
        follower.tick(t_s)

    leader.send_tick = send_tick
    follower.send_ack = lambda t_s: leader.ack("mmu", t_s)
    ahead_s: list[float] = []

    def follow() -> None:
        due_s = 0.0
        while due_s < 1.0:
            step_s = follower.wait_until(due_s, stop)
            ahead_s.append(leader.now_s() - step_s)
            due_s = round(due_s + 0.05, 9)
        follower.send_ack(float("inf"))

    leader.ack("mmu", 0.0)
    thread = threading.Thread(target=follow, daemon=True)
    thread.start()
    assert leader.wait_until(2.0, stop) == 2.0
    thread.join(5.0)
    assert not thread.is_alive()
    assert len(ticks) == round(2.0 / TICK_S)
    # Measured between two threads: the leader may take one more tick while the follower wakes up
    assert max(ahead_s) <= WINDOW_S + 0.05 + TICK_S


def test_follower_never_goes_back() -> None:
    follower = FollowerClock()
    follower.tick(2.0)
    follower.tick(1.0)
    assert follower.now_s() == 2.0


def test_stop_ends_a_wait_that_no_tick_ends() -> None:
    stop = threading.Event()
    follower = FollowerClock()
    threading.Timer(0.05, stop.set).start()
    follower.wait_until(1.0, stop)
    assert stop.is_set()


@pytest.mark.timeout(20)
def test_a_follower_in_a_long_step_says_that_it_is_still_at_it() -> None:
    stop, said = threading.Event(), threading.Event()
    follower = FollowerClock()
    answers: list[float] = []

    def ack(t_s: float) -> None:
        answers.append(t_s)
        if len(answers) > 1:
            said.set()
        else:
            follower.tick(1.0)

    follower.send_ack = ack
    follower.tick(TICK_S)
    follower.begin(stop)
    follower.wait_until(1.0, stop)
    # The step of 1.0 has begun and does not end
    assert said.wait(SILENT_S)
    stop.set()
    assert set(answers) == {1.0}


@pytest.mark.timeout(20)
def test_what_was_lost_on_the_way_is_said_again() -> None:
    stop = threading.Event()
    leader, follower = LeaderClock(speed=1000.0), FollowerClock()
    lost = {"tick": 1, "ack": 1}

    def send_tick(t_s: float) -> None:
        if t_s < 0.1 or not lost["tick"]:
            follower.tick(t_s)
        else:
            lost["tick"] -= 1

    def send_ack(t_s: float) -> None:
        if t_s < 0.2 or not lost["ack"]:
            leader.ack("mmu", t_s)
        else:
            lost["ack"] -= 1

    def follow() -> None:
        due_s = follower.begin(stop)
        while not stop.is_set():
            follower.wait_until(due_s, stop)
            due_s = round(due_s + TICK_S, 9)

    leader.send_tick, follower.send_ack = send_tick, send_ack
    leader.ack("mmu", 0.0)
    thread = threading.Thread(target=follow, daemon=True)
    thread.start()
    leader.wait_until(0.5, stop)
    assert lost == {"tick": 0, "ack": 0}
    assert not leader._table.silent
    stop.set()
    thread.join(5.0)


def test_announcements_keep_the_newest_of_each_topic_and_are_handed_on_once() -> None:
    sender, leader = Announcements(), Announcements()
    sender.note("mmu/pose", 7, 1)
    sender.note("mmu/pose", 7, 2)
    sender.note("mmu/status", 7, 1)
    leader.merge(sender.take())
    assert sender.take() == ((), (), ())
    assert leader.take() == (("mmu/pose", "mmu/status"), (7, 7), (2, 1))


def test_a_message_is_not_older_than_the_step_that_sees_it_first() -> None:
    follower = FollowerClock()
    follower.tick(1.0)
    follower.wait_until(0.98, threading.Event())
    assert follower.arrival_s(0.94) == 0.98
    assert follower.arrival_s(1.0) == 1.0
