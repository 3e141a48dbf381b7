"""The Communication Module: `STATUS[*]`, tokens, `STOP` -> `PERMIT` at 10 Hz and at once on change.

Its process is the Zenoh router of the BeagleBone. Nothing here waits: a permit that comes late stops the robot.
"""

from __future__ import annotations

import argparse
import logging
import secrets
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol, runtime_checkable

from common.bus import Bus
from common.config import CommSection, Config
from common.constants import PERMIT_RATE_HZ
from common.errors import ErrorCode
from common.messages import PERMIT, STATUS, STOP, Permit
from common.signing import CHALLENGE_BYTES, CHALLENGE_PERIOD_S
from common.status import StatusReporter
from onboard.comm.outbox import FILE_NAME, Outbox
from onboard.comm.stop_latch import RECORD_NAME, StopLatch, load_latch, save_latch
from onboard.comm.watchdog import ModuleReading, Verdict, WatchdogState, watch

OFFBOARD_WATCHED = "recorder"

_log = logging.getLogger("comm")


@runtime_checkable
class TokenBus(Protocol):
    """A bus between processes, which knows whose process runs. In lockstep there is no process that could die."""

    def alive_tokens(self) -> frozenset[str]: ...


@dataclass(slots=True)
class _Beat:
    count: int = -1
    seen_s: float = float("-inf")


class Comm:
    """The node. `latch_record` is the file by which a stop outlives a restart of this process, None for none.

    `outbox` takes what goes to the recorder; without one nothing does. `new_challenge` draws what commands are signed
    over; without one none need be signed.
    """

    name = "comm"
    period_s = 0.02

    def __init__(
        self,
        settings: CommSection,
        latch_record: Path | None = None,
        outbox: Outbox | None = None,
        new_challenge: Callable[[], bytes] | None = None,
    ) -> None:
        self._settings = settings
        self._latch_record = latch_record
        self._latch = load_latch(latch_record) if latch_record else StopLatch()
        self._outbox = outbox
        self._watchdog: WatchdogState | None = None
        self._beats: dict[str, _Beat] = {}
        self._permit: Permit | None = None
        self._permit_due_s = float("-inf")
        self._new_challenge = new_challenge
        self._challenge = b""
        self._challenge_due_s = float("-inf")
        self._status = StatusReporter(self.name)

    def step(self, bus: Bus, now_s: float) -> None:
        before = self._latch
        for request in bus.take(STOP):
            self._latch = self._latch.after(request)
        tokens = bus.alive_tokens() if isinstance(bus, TokenBus) else None
        verdict = self._watch(bus, now_s, tokens)
        self._publish_permit(bus, now_s, verdict)
        recorder_away = tokens is not None and OFFBOARD_WATCHED not in tokens
        self._report(bus, now_s, verdict, recorder_away)
        # After the permit: the disk may take its time
        if self._latch != before:
            _log.info("stop sources=%s", sorted(self._latch.sources))
            if self._latch_record:
                save_latch(self._latch_record, self._latch)
        if self._outbox is not None:
            self._outbox.step(bus, now_s)

    def close(self) -> None:
        if self._outbox is not None:
            self._outbox.close()

    def _watch(self, bus: Bus, now_s: float, tokens: frozenset[str] | None) -> Verdict:
        required = self._settings.required
        if self._settings.stop_when_offboard_missing:
            required = (*required, OFFBOARD_WATCHED)
        readings = {module: self._read(bus, module, now_s, tokens) for module in required}
        state = self._watchdog or WatchdogState(started_s=now_s)
        self._watchdog, verdict = watch(state, readings, now_s)
        return verdict

    def _read(self, bus: Bus, module: str, now_s: float, tokens: frozenset[str] | None) -> ModuleReading:
        status = bus.latest(STATUS[module])
        beat = self._beats.setdefault(module, _Beat())
        if status is not None and status.beats != beat.count:
            beat.count, beat.seen_s = status.beats, now_s
        return ModuleReading(
            token=tokens is None or module in tokens,
            status_age_s=bus.age_s(STATUS[module]),
            beat_age_s=now_s - beat.seen_s,
            ready=status is not None and status.ready and status.valid,
            state=status.state if status is not None else "nothing heard",
        )

    def _publish_permit(self, bus: Bus, now_s: float, verdict: Verdict) -> None:
        sources = tuple(sorted(self._latch.sources))
        reason = f"stopped by {', '.join(sources)}" if sources else verdict.reason
        permit = Permit(now_s, verdict.granted and not sources, reason, sources, challenge=self._challenge)
        old = self._permit
        changed = old is None or (old.granted, old.stop_sources) != (permit.granted, permit.stop_sources)
        if not changed and now_s < self._permit_due_s:
            return
        if changed:
            _log.info("permit granted=%s reason=%s", permit.granted, reason or "-")
        if self._new_challenge is not None and now_s >= self._challenge_due_s:
            self._challenge, self._challenge_due_s = self._new_challenge(), now_s + CHALLENGE_PERIOD_S
            permit = replace(permit, challenge=self._challenge)
        self._permit, self._permit_due_s = permit, now_s + 1.0 / PERMIT_RATE_HZ - self.period_s / 2
        bus.publish(PERMIT, permit)

    def _report(self, bus: Bus, now_s: float, verdict: Verdict, recorder_away: bool) -> None:
        if self._latch.sources:
            state, error = "STOPPED", ErrorCode.OPERATOR_STOP
        elif verdict.granted:
            state, error = "GRANTED", ErrorCode.RECORDER_AWAY if recorder_away else ErrorCode.OK
        elif verdict.starting:
            state, error = "STARTING", ErrorCode.OK
        else:
            state, error = "WAITING", ErrorCode.MODULE_MISSING
        self._status.report(bus, now_s, state=state, error=error, ready=True, detail=verdict.reason)


def make_comm(config: Config, arguments: argparse.Namespace) -> Comm:
    """The node of the process; the stop's record and the outbox stand in the log folder."""
    folder: Path | None = arguments.log_dir
    outbox = Outbox(folder / FILE_NAME if folder else None, config.comm.outbox_limit_mb * 1_000_000)
    new_challenge = (lambda: secrets.token_bytes(CHALLENGE_BYTES)) if config.mesh.keys else None
    return Comm(config.comm, folder / RECORD_NAME if folder else None, outbox, new_challenge)
