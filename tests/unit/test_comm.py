"""comm: the watchdog's judgement, the stop latch, and the permit that follows from both."""

from __future__ import annotations

import time
from argparse import Namespace
from collections.abc import Callable
from dataclasses import replace
from errno import ENOSPC
from itertools import count, pairwise
from pathlib import Path

import pytest

from common.bus import LocalBus, LocalMesh
from common.config import CommSection, Config
from common.constants import STARTUP_GRACE_S, WATCHDOG_CLEAR_S
from common.errors import ErrorCode, StartError
from common.messages.health import Status
from common.messages.mission import Operation, OperatorCommand
from common.messages.motion import CarrierReport, CarrierState
from common.messages.stop import Permit, StopRequest
from common.messages.topics import CARRIER, OPERATION, PERMIT, STATUS, STOP
from common.signing import CHALLENGE_PERIOD_S
from onboard.comm import stop_keeper
from onboard.comm.comm import Comm, make_comm
from onboard.comm.stop_keeper import StopKeeper
from onboard.comm.stop_record import RECORD_NAME, StopRecord, write_record
from onboard.comm.watchdog import ModuleReading, WatchdogState, fault_of, watch

SOUND = ModuleReading(token=True, status_age_s=0.05, heartbeat_age_s=0.05, ready=True, state="RUN")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"token": False}, "not running"),
        ({"status_age_s": 0.21}, "silent"),
        ({"status_age_s": float("inf")}, "silent"),
        ({"heartbeat_age_s": 0.21}, "stands still"),
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


def test_nobody_required_is_no_permit() -> None:
    _, verdict = watch(WatchdogState(0.0), {}, 100.0)
    assert not verdict.granted
    assert "no module is required" in verdict.reason


@pytest.mark.parametrize("required", [(), ("mmu", "planner")])
def test_comm_does_not_begin_without_a_bridge_to_require(tmp_path: Path, required: tuple[str, ...]) -> None:
    config = Config(comm=CommSection(required=required))
    with pytest.raises(StartError, match="required"):
        make_comm(config, Namespace(log_dir=tmp_path))


class Bench:
    """comm in lockstep with modules that are only statuses."""

    def __init__(
        self,
        settings: CommSection | None = None,
        record: Path | None = None,
        life: int = 1,
        bridge_epoch: int = 0,
        new_challenge: Callable[[], bytes] | None = None,
    ) -> None:
        self.settings = settings or CommSection(required=("bridge", "mmu"))
        self.mesh = LocalMesh()
        self.bus: LocalBus = self.mesh.endpoint("test")
        self.stops = StopKeeper(record, life=life)
        self.comm = Comm(self.settings, self.stops, new_challenge=new_challenge)
        self.comm_bus = self.mesh.endpoint("comm")
        self.silent: set[str] = set()
        self.heartbeat_count = 0
        self.permits: list[tuple[float, Permit]] = []
        self.bridge_epoch = bridge_epoch
        self.button_pressed = False
        self.bus.take(PERMIT)

    def run(self, duration_s: float) -> None:
        end_s = self.mesh.now_s + duration_s
        while self.mesh.now_s < end_s - 1e-9:
            self.mesh.now_s = round(self.mesh.now_s + 0.02, 6)
            if round(self.mesh.now_s / 0.02) % 5 == 0:
                self.heartbeat_count += 1
                for module in set(self.settings.required) - self.silent:
                    self.bus.publish(STATUS[module], Status(self.mesh.now_s, "RUN", 0, 0, True, self.heartbeat_count))
                self._report()
            self.comm.step(self.comm_bus, self.mesh.now_s)
            self.permits += [(self.mesh.now_s, p) for p in self.bus.take(PERMIT)]

    def _report(self) -> None:
        """What the bridge says of stops."""
        permit = self.permits[-1][1] if self.permits else Permit(0.0, False, "")
        self.bridge_epoch = max(self.bridge_epoch, permit.stop_epoch)
        report = CarrierReport(self.mesh.now_s, CarrierState.READY, 0, 0, 0, 0.0, 0, 0, True, False, 12.0)
        report = replace(
            report, bridge_epoch=self.bridge_epoch, comm_life=permit.life, button_pressed=self.button_pressed
        )
        self.bus.publish(CARRIER, report)

    def press(self, stop_id: int = 5) -> None:
        self.bus.publish(STOP, StopRequest(0.0, "operator", True, stop_id=stop_id))

    def release(self, epoch: int | None = None, valid: bool = True) -> None:
        named = self.permit.stop_epoch if epoch is None else epoch
        self.bus.publish(STOP, StopRequest(0.0, "operator", False, valid=valid, epoch=named))

    def operate(self, operation: Operation, epoch: int | None = None) -> None:
        named = self.permit.stop_epoch if epoch is None else epoch
        self.bus.publish(OPERATION, OperatorCommand(0.0, operation, epoch=named))

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
    bench.press()
    bench.run(0.02)
    assert bench.permit.stop_sources == ("operator",)
    bench.run(5.0)
    assert not bench.permit.granted
    bench.release()
    bench.run(2.0)
    assert (bench.permit.stop_sources, bench.permit.granted, bench.permit.resumed) == ((), False, False)
    bench.operate(Operation.RESUME)
    bench.run(0.1)
    assert bench.permit.granted


def latched_bench(record: Path | None = None) -> Bench:
    bench = Bench(record=record)
    bench.run(2.0)
    bench.press()
    bench.run(0.1)
    assert bench.permit.stop_ids == (5,)
    return bench


@pytest.mark.parametrize("operation", [o for o in Operation if o is not Operation.RESUME])
def test_nothing_but_a_resume_is_a_resume(operation: Operation) -> None:
    bench = latched_bench()
    bench.release()
    bench.run(0.1)
    bench.operate(operation)
    bench.run(2.0)
    assert not bench.permit.granted
    assert "waiting for a resume" in bench.permit.reason


def test_a_resume_before_the_release_is_none() -> None:
    bench = latched_bench()
    bench.operate(Operation.RESUME)
    bench.run(0.1)
    bench.release()
    bench.run(2.0)
    assert not bench.permit.granted


def test_every_press_is_a_stop_of_its_own_and_an_older_release_does_not_lift_it() -> None:
    bench = latched_bench()
    seen = bench.permit.stop_epoch
    bench.press(stop_id=6)
    bench.run(0.1)
    assert bench.permit.stop_epoch == seen + 1
    bench.release(epoch=seen)
    bench.run(0.5)
    assert bench.permit.stop_ids == (5, 6)


def test_repeats_of_a_press_make_no_further_epoch() -> None:
    bench = latched_bench()
    seen = bench.permit.stop_epoch
    for _ in range(20):
        bench.press()
        bench.run(0.02)
    assert bench.permit.stop_epoch == seen


def test_a_release_that_its_sender_does_not_stand_behind_releases_nothing() -> None:
    bench = latched_bench()
    bench.release(valid=False)
    bench.run(0.5)
    assert bench.permit.stop_sources == ("operator",)


def test_no_release_while_the_button_on_the_robot_is_pressed() -> None:
    bench = latched_bench()
    bench.button_pressed = True
    bench.run(0.3)
    bench.release()
    bench.run(0.5)
    assert bench.permit.stop_sources
    assert "button on the robot is pressed" in bench.permit.reason
    bench.button_pressed = False
    bench.run(0.3)
    bench.release()
    bench.run(0.5)
    assert not bench.permit.stop_sources


def test_permit_is_repeated_ten_times_a_second() -> None:
    bench = Bench()
    bench.run(2.0)
    bench.permits.clear()
    bench.run(2.0)
    assert len(bench.permits) == pytest.approx(20, abs=1)


def stop_record(folder: Path) -> Path:
    record = folder / RECORD_NAME
    write_record(record, StopRecord())
    return record


def test_a_restarted_comm_still_knows_the_stop_and_a_release_of_the_time_before_is_void(tmp_path: Path) -> None:
    record = stop_record(tmp_path)
    bench = latched_bench(record)
    until_stored(bench)
    again = Bench(record=record, life=2, bridge_epoch=bench.bridge_epoch)
    again.run(3.0)
    assert not again.permit.granted
    assert again.permit.stop_sources == ("operator",)
    again.release(epoch=bench.permit.stop_epoch)
    again.run(0.5)
    assert again.permit.stop_sources == ("operator",)


def until_stored(bench: Bench) -> None:
    deadline_s = time.monotonic() + 5.0
    while bench.stops.state.to_store is not None:
        assert time.monotonic() < deadline_s
        bench.run(0.02)
        time.sleep(0.005)


def restarted(record: Path, bridge_epoch: int) -> Permit:
    bench = Bench(record=record, life=2, bridge_epoch=bridge_epoch)
    bench.run(3.0)
    return bench.permit


def test_a_killed_comm_goes_on_where_the_bridge_knows_no_newer_stop(tmp_path: Path) -> None:
    record = stop_record(tmp_path)
    Bench(record=record).run(2.0)
    assert restarted(record, bridge_epoch=1).granted


@pytest.mark.parametrize("lost", ["missing", "damaged", "older than the bridge", "and the bridge was restarted too"])
def test_whatever_may_have_lost_a_stop_is_one(tmp_path: Path, lost: str) -> None:
    record = stop_record(tmp_path)
    Bench(record=record).run(2.0)
    if lost == "missing":
        record.unlink()
    elif lost == "damaged":
        text = record.read_text()
        record.write_text(text.replace('"epoch": 1', '"epoch": 9'))
    permit = restarted(record, {"older than the bridge": 2, "and the bridge was restarted too": 0}.get(lost, 1))
    assert permit.stop_sources
    assert not permit.granted
    assert permit.stop_epoch > 2


def test_a_stop_works_while_the_disk_refuses_and_a_release_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench(record=stop_record(tmp_path))
    bench.run(2.0)
    assert bench.permit.granted

    def refuse(*_: object) -> None:
        raise OSError(ENOSPC, "No space left on device")

    monkeypatch.setattr(stop_keeper, "write_record", refuse)
    bench.press()
    bench.run(0.02)
    assert bench.permit.stop_sources == ("operator",)
    until_told(bench)
    bench.release()
    bench.run(0.5)
    assert bench.permit.stop_sources == ("operator",)
    monkeypatch.undo()
    bench.run(2.0)
    until_stored(bench)
    bench.release()
    until_stored(bench)
    bench.run(0.1)
    assert not bench.permit.stop_sources


def until_told(bench: Bench) -> None:
    deadline_s = time.monotonic() + 5.0
    while not bench.stops.trouble:
        assert time.monotonic() < deadline_s
        bench.run(0.02)
        time.sleep(0.005)
    assert "No space left" in bench.stops.trouble


def test_missing_recorder_stops_only_when_the_configuration_asks() -> None:
    bench = Bench(CommSection(required=("bridge", "mmu"), stop_when_offboard_missing=True))
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
