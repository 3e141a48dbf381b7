"""comm: the watchdog's judgement, the stop latch, and the permit that follows from both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import count, pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.bus import LocalBus, LocalMesh
from common.config import CommSection
from common.constants import STARTUP_GRACE_S, WATCHDOG_CLEAR_S
from common.errors import ErrorCode
from common.messages import PERMIT, STATUS, STOP, Permit, Status, StopRequest
from common.signing import CHALLENGE_PERIOD_S
from onboard.comm.comm import Comm
from onboard.comm.stop_latch import RECORD_NAME, StopLatch, load_latch, save_latch
from onboard.comm.watchdog import ModuleReading, WatchdogState, fault_of, watch

SOUND = ModuleReading(token=True, status_age_s=0.05, beat_age_s=0.05, ready=True, state="RUN")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"token": False}, "not running"),
        ({"status_age_s": 0.21}, "silent"),
        ({"status_age_s": float("inf")}, "silent"),
        ({"beat_age_s": 0.21}, "stands still"),
        ({"ready": False}, "not ready (RUN)"),
    ],
)
def test_every_fault_is_named(change: dict[str, float], said: str) -> None:
    fault = fault_of("mmu", replace(SOUND, **change))  # type: ignore[arg-type]
    assert fault is not None
    assert said in fault
    assert fault_of("mmu", SOUND) is None


def test_permit_comes_after_a_second_of_soundness_and_goes_at_once() -> None:
    state = WatchdogState(0.0)
    state, verdict = watch(state, {"mmu": SOUND}, 5.0)
    assert not verdict.granted
    state, verdict = watch(state, {"mmu": SOUND}, 5.0 + WATCHDOG_CLEAR_S)
    assert verdict.granted
    state, verdict = watch(state, {"mmu": replace(SOUND, token=False)}, 6.1)
    assert not verdict.granted
    assert not verdict.starting
    state, verdict = watch(state, {"mmu": SOUND}, 6.2)
    assert not verdict.granted
    _, verdict = watch(state, {"mmu": SOUND}, 6.2 + WATCHDOG_CLEAR_S)
    assert verdict.granted


def test_start_up_is_no_fault_until_the_grace_is_over() -> None:
    missing = {"mmu": replace(SOUND, token=False)}
    assert watch(WatchdogState(0.0), missing, STARTUP_GRACE_S - 1)[1].starting
    assert not watch(WatchdogState(0.0), missing, STARTUP_GRACE_S + 1)[1].starting


@given(st.lists(st.tuples(st.sampled_from("abc"), st.booleans())))
def test_latch_holds_exactly_the_sources_whose_last_word_was_stop(words: list[tuple[str, bool]]) -> None:
    latch = StopLatch()
    for source, latched in words:
        latch = latch.after(StopRequest(0.0, source, latched))
    assert latch.sources == {source for source, latched in dict(words).items() if latched}


def test_a_release_that_its_sender_does_not_stand_behind_releases_nothing() -> None:
    latch = StopLatch(frozenset({"operator"}))
    assert latch.after(StopRequest(0.0, "operator", latched=False, valid=False)) == latch


def test_latch_outlives_a_restart_and_an_unreadable_record_is_a_stop(tmp_path: Path) -> None:
    record = tmp_path / RECORD_NAME
    assert load_latch(record) == StopLatch()
    save_latch(record, StopLatch(frozenset({"operator", "web"})))
    assert load_latch(record).sources == {"operator", "web"}
    record.write_text("{")
    assert load_latch(record).sources


class Bench:
    """comm in lockstep with modules that are only statuses."""

    def __init__(
        self,
        settings: CommSection | None = None,
        record: Path | None = None,
        new_challenge: Callable[[], bytes] | None = None,
    ) -> None:
        self.settings = settings or CommSection(required=("bridge", "mmu"))
        self.mesh = LocalMesh()
        self.bus: LocalBus = self.mesh.endpoint("test")
        self.comm = Comm(self.settings, record, new_challenge=new_challenge)
        self.comm_bus = self.mesh.endpoint("comm")
        self.silent: set[str] = set()
        self.beats = 0
        self.permits: list[tuple[float, Permit]] = []
        self.bus.take(PERMIT)

    def run(self, duration_s: float) -> None:
        end_s = self.mesh.now_s + duration_s
        while self.mesh.now_s < end_s - 1e-9:
            self.mesh.now_s = round(self.mesh.now_s + 0.02, 6)
            if round(self.mesh.now_s / 0.02) % 5 == 0:
                self.beats += 1
                for module in set(self.settings.required) - self.silent:
                    self.bus.publish(STATUS[module], Status(self.mesh.now_s, "RUN", 0, 0, True, self.beats))
            self.comm.step(self.comm_bus, self.mesh.now_s)
            self.permits += [(self.mesh.now_s, p) for p in self.bus.take(PERMIT)]

    @property
    def permit(self) -> Permit:
        return self.permits[-1][1]


@pytest.mark.requirement("CM_MR_02")
def test_permit_is_revoked_within_250_ms_of_a_module_falling_silent() -> None:
    bench = Bench()
    bench.run(2.0)
    assert bench.permit.granted
    bench.silent = {"mmu"}
    last_status_s = bench.mesh.now_s
    bench.run(0.5)
    revoked_s = next(t for t, p in bench.permits if t > last_status_s and not p.granted)
    assert revoked_s - last_status_s <= 0.25
    assert "mmu" in bench.permit.reason
    status = bench.bus.latest(STATUS["comm"])
    assert status is not None
    assert status.error_code == ErrorCode.MODULE_MISSING


def test_watchdog_stop_clears_itself_and_the_operators_does_not() -> None:
    bench = Bench()
    bench.run(2.0)
    bench.silent = {"mmu"}
    bench.run(1.0)
    bench.silent = set()
    bench.run(1.3)
    assert bench.permit.granted
    bench.bus.publish(STOP, StopRequest(0.0, "operator", latched=True))
    bench.run(0.02)
    assert bench.permit.stop_sources == ("operator",)
    bench.run(5.0)
    assert not bench.permit.granted
    bench.bus.publish(STOP, StopRequest(0.0, "operator", latched=False))
    bench.run(0.02)
    assert bench.permit.granted


def test_permit_is_repeated_ten_times_a_second() -> None:
    bench = Bench()
    bench.run(2.0)
    bench.permits.clear()
    bench.run(2.0)
    assert len(bench.permits) == pytest.approx(20, abs=1)


def test_a_restarted_comm_still_knows_the_stop(tmp_path: Path) -> None:
    record = tmp_path / RECORD_NAME
    bench = Bench(record=record)
    bench.run(2.0)
    bench.bus.publish(STOP, StopRequest(0.0, "operator", latched=True))
    bench.run(0.1)
    again = Bench(record=record)
    again.run(3.0)
    assert not again.permit.granted
    assert again.permit.stop_sources == ("operator",)


def test_missing_recorder_stops_only_when_the_configuration_asks() -> None:
    bench = Bench(CommSection(required=("mmu",), stop_when_offboard_missing=True))
    bench.run(3.0)
    assert not bench.permit.granted
    assert "recorder" in bench.permit.reason


def test_challenge_is_renewed_in_time_and_stands_in_every_permit() -> None:
    numbers = count(1)
    bench = Bench(new_challenge=lambda: bytes([next(numbers)]))
    bench.run(10.5 * CHALLENGE_PERIOD_S)
    changes_s = [s for (_, a), (s, b) in pairwise(bench.permits) if a.challenge != b.challenge]
    assert all(permit.challenge for _, permit in bench.permits)
    assert len(changes_s) == 10
    assert all(abs(b - a - CHALLENGE_PERIOD_S) < 0.15 for a, b in pairwise(changes_s))


def test_without_keys_there_is_no_challenge() -> None:
    bench = Bench()
    bench.run(3.0)
    assert {permit.challenge for _, permit in bench.permits} == {b""}
