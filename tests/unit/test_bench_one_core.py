"""The slowed core gives its processes the share that it shall; and what counts as a disturbance of a mission on it."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import pytest

from common.messages.stop import Permit
from deploy.bench.core_quota import ByTurns, DutyCycle, ThrottledCore, cores
from deploy.bench.one_core import MotorRow, Withdrawn, switched_off, wheels_off_s
from deploy.bench.process_cost import threads
from deploy.bench.waiting import BenchFailed, until

FACTOR = 15.0
MEASURED_S = 1.0


@pytest.fixture
def busy() -> Iterator[int]:
    """A process that always has something to do."""
    process = subprocess.Popen([sys.executable, "-c", "print(flush=True)\nwhile True: pass"], stdout=subprocess.PIPE)
    try:
        assert process.stdout is not None
        process.stdout.readline()
        yield process.pid
    finally:
        process.kill()
        process.communicate()


def cpu_s(pid: int) -> float:
    return sum(thread.cpu_s for thread in threads([pid]).values())


@pytest.mark.parametrize("make", [ByTurns, DutyCycle])
def test_a_busy_loop_gets_its_share_of_the_core_and_goes_on_afterwards(
    make: Callable[[int, float], ThrottledCore], busy: int
) -> None:
    try:
        core, _ = cores()
        slowed = make(core, FACTOR)
    except (BenchFailed, OSError) as error:
        pytest.skip(f"no core can be slowed this way here: {error}")
    try:
        slowed.add([busy])
        time.sleep(0.2)
        began_s, before_s = time.monotonic(), cpu_s(busy)
        time.sleep(MEASURED_S)
        share = (cpu_s(busy) - before_s) / (time.monotonic() - began_s)
    finally:
        slowed.close()
    # Wide: on a busy machine it shares its part with others, and who lets it run wakes too late to stop it in time
    assert 0.0 < share < 4.0 / FACTOR
    before_s = cpu_s(busy)
    until(lambda: cpu_s(busy) - before_s > 0.5, 60.0, "time for what is slow no more")


def test_naming_a_process_again_or_one_that_is_gone_changes_nothing(busy: int) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    try:
        slowed = ByTurns(cores()[0], FACTOR)
    except (BenchFailed, OSError) as error:
        pytest.skip(f"no real-time priority here: {error}")
    try:
        for _ in range(2):
            slowed.add([busy, ended.pid])
    finally:
        slowed.close()


def permit(granted: bool, reason: str = "") -> Permit:
    return Permit(1.0, granted, reason)


def test_each_permit_that_is_withdrawn_counts_once_with_its_reason() -> None:
    seen = Withdrawn()
    for message in (permit(False), permit(True), permit(False, "mmu is silent"), permit(False, "mmu is silent")):
        seen.permit(message)
    assert seen.reasons == {"mmu is silent": 1}


def test_what_follows_a_stop_of_a_person_is_no_disturbance() -> None:
    seen = Withdrawn()
    seen.permit(permit(True))
    seen.forget()
    seen.permit(permit(False, "stopped"))
    assert seen.reasons.total() == 0


DROVE: MotorRow = (10.0, 114, 114, True)
BRAKED: MotorRow = (10.4, 0, 0, True)
OFF: MotorRow = (10.5, 0, 0, False)


def test_wheels_are_off_when_the_driver_is_off_too() -> None:
    assert wheels_off_s([DROVE, BRAKED, OFF], 10.25) == pytest.approx(0.25)
    assert wheels_off_s([DROVE, BRAKED], 10.25) is None


def test_a_robot_that_stood_already_has_no_latency() -> None:
    assert wheels_off_s([DROVE, OFF, (12.0, 114, 114, True)], 11.0) is None
    assert wheels_off_s([], 11.0) is None


def test_the_driver_that_is_switched_off_while_nobody_stops_the_robot_counts_once() -> None:
    rows = [DROVE, BRAKED, OFF, (11.0, 0, 0, True), (12.0, 114, 114, True), (13.0, 0, 0, False)]
    assert switched_off(rows, [(10.0, 14.0)]) == 2
    assert switched_off(rows, [(10.0, 11.0)]) == 1
    assert switched_off(rows, [(10.6, 12.5)]) == 0
