"""The Communication Module: `STATUS[*]`, tokens, `STOP`, `CARRIER`, resumes -> `PERMIT` at 10 Hz and on change.

Its process is the Zenoh router of the BeagleBone. Nothing here waits: a permit that comes late stops the robot.
"""

from __future__ import annotations

import argparse
import logging
import secrets
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from common.board_state import BoardReporter
from common.bus import Bus
from common.config import CommSection, Config
from common.constants import PERMIT_RATE_HZ
from common.errors import ErrorCode, StartError
from common.fields import CHALLENGE_BYTES
from common.messages.mission import Operation
from common.messages.stop import Permit
from common.messages.topics import CARRIER, ODOMETRY, OPERATION, PERMIT, STATUS, STOP, Topic
from common.modules import ON_ROBOT
from common.pace import Pace
from common.release import Release, own_release
from common.signing import CHALLENGE_PERIOD_S
from common.status import StatusReporter
from onboard.comm import stop_owner
from onboard.comm.outbox import FILE_NAME, Outbox
from onboard.comm.permit_file import PermitFile, permit_file
from onboard.comm.spool import Spool, spool_folder
from onboard.comm.stop_keeper import StopKeeper
from onboard.comm.stop_owner import BridgeReport, Phase
from onboard.comm.stop_record import RECORD_NAME, Stop, StopRecord
from onboard.comm.watchdog import ModuleReading, Verdict, WatchdogState, release_faults, silent_in_s, watch

OFFBOARD_WATCHED = "recorder"
BRIDGE = "bridge"
LIFE_BITS = 53
_WATCHED = tuple(name for name in ON_ROBOT if name != "comm")

_JUST_AFTER_S = 0.001  # at its greatest age a status still counts

_log = logging.getLogger("comm")


@runtime_checkable
class TokenBus(Protocol):
    """A bus between processes, with the liveliness tokens of those that run. The bus of lockstep has none."""

    def alive_tokens(self) -> frozenset[str]: ...

    def alive_releases(self) -> frozenset[tuple[str, Release]]: ...


@dataclass(slots=True)
class _Heartbeat:
    count: int = -1
    seen_s: float = float("-inf")


class Comm:
    """The node. `stops` keeps the stop over restarts; without it the robot forgets it with this process.

    `outbox` takes what goes to the recorder; without one nothing does. `new_challenge` draws what commands are signed
    over; without one none need be signed. `permit_file` is for `deploy`. `board` reports on the
    computer.
    """

    name = "comm"
    period_s = 0.1
    # Of the reports only what is news: a stop that bridge or board hold, a module that is ready no more. Odometry, so
    # that its own period is in step with that of the others: it costs less when all work at the same time
    wakes_on: tuple[Topic[Any], ...] = (STOP, OPERATION, CARRIER, ODOMETRY, *(STATUS[name] for name in _WATCHED))

    def __init__(
        self,
        settings: CommSection,
        stops: StopKeeper | None = None,
        outbox: Outbox | None = None,
        new_challenge: Callable[[], bytes] | None = None,
        permit_file: PermitFile | None = None,
        board: BoardReporter | None = None,
    ) -> None:
        self._settings = settings
        self._stops = stops or StopKeeper(None)
        self._outbox = outbox
        self._board = board
        self._watchdog: WatchdogState | None = None
        self._heartbeats: dict[str, _Heartbeat] = {}
        # Of the newest permit what must be published at once when it changes
        self._published: tuple[bool, int, StopRecord] | None = None
        self._permit_pace = Pace(1.0 / PERMIT_RATE_HZ)
        self._new_challenge = new_challenge
        self._permit_file = permit_file
        self._challenge = b""
        self._challenge_due_s = float("-inf")
        self._status = StatusReporter(self.name)
        self._bus: Bus | None = None
        self._mesh: TokenBus | None = None  # that bus, where it joins processes

    def step(self, bus: Bus, now_s: float) -> float:
        self._take_stops(bus)
        self._stops.step(now_s)
        mesh = self._mesh_of(bus)
        tokens = mesh.alive_tokens() if mesh is not None else None
        readings = self._readings(bus, now_s, tokens)
        faults = release_faults(mesh.alive_releases(), own_release()) if mesh is not None else ()
        self._watchdog, verdict = watch(self._watchdog or WatchdogState(started_s=now_s), readings, now_s, faults)
        self._publish_permit(bus, now_s, verdict)
        recorder_away = tokens is not None and OFFBOARD_WATCHED not in tokens
        self._report(bus, now_s, verdict, recorder_away)
        due_s = [self._permit_pace.latest_s, self._status.latest_s, self._stops.due_s(now_s)]
        due_s.append(now_s + silent_in_s(readings) + _JUST_AFTER_S)
        if self._outbox is not None:
            self._outbox.step(bus, now_s)
            due_s.append(self._outbox.due_s(now_s))
        if self._board is not None:
            self._board.report(bus, now_s)
        return min(due_s)

    def close(self) -> None:
        if self._permit_file is not None:
            self._permit_file.write(granted=False)
        self._stops.close()
        if self._outbox is not None:
            self._outbox.close()

    def _mesh_of(self, bus: Bus) -> TokenBus | None:
        if bus is not self._bus:  # the check takes longer than the rest of a step
            self._bus, self._mesh = bus, bus if isinstance(bus, TokenBus) else None
        return self._mesh

    def _take_stops(self, bus: Bus) -> None:
        """Takes stops, releases, resumes and reports. A stop counts even where `valid` is false."""
        for request in bus.take(STOP):
            if request.latched:
                self._stops.change(partial(stop_owner.press, stop=Stop(request.source, request.stop_id)))
            elif request.valid:
                self._stops.change(partial(stop_owner.release, epoch=request.epoch))
        for command in bus.take(OPERATION):
            if command.operation is Operation.RESUME and command.valid:
                self._stops.change(partial(stop_owner.resume, epoch=command.epoch))
        for report in bus.take(CARRIER):
            stops = tuple(map(Stop, report.stop_names, report.stop_ids))
            epochs = report.bridge_epoch, report.board_epoch
            known = BridgeReport(report.comm_life, *epochs, stops, report.button_pressed)
            self._stops.change(partial(stop_owner.on_report, report=known))

    def _readings(self, bus: Bus, now_s: float, tokens: frozenset[str] | None) -> dict[str, ModuleReading]:
        required = self._settings.required
        if self._settings.stop_when_offboard_missing:
            required = (*required, OFFBOARD_WATCHED)
        return {module: self._read(bus, module, now_s, tokens) for module in required}

    def _read(self, bus: Bus, module: str, now_s: float, tokens: frozenset[str] | None) -> ModuleReading:
        status, age_s = bus.latest(STATUS[module]), bus.age_s(STATUS[module])
        heartbeat = self._heartbeats.setdefault(module, _Heartbeat())
        if status is not None and status.heartbeat_count != heartbeat.count:
            heartbeat.count, heartbeat.seen_s = status.heartbeat_count, now_s - age_s
        return ModuleReading(
            token=tokens is None or module in tokens,
            status_age_s=age_s,
            heartbeat_age_s=now_s - heartbeat.seen_s,
            ready=status is not None and status.ready and status.valid,
            state=status.state if status is not None else "no status received",
        )

    def _publish_permit(self, bus: Bus, now_s: float, verdict: Verdict) -> None:
        stop = self._stops.state
        record, granted = stop.record, verdict.granted and stop.may_grant
        essence = granted, stop.epoch, record
        changed = essence != self._published
        if not self._permit_pace.due(now_s, urgent=changed):
            return
        if self._new_challenge is not None and now_s >= self._challenge_due_s:
            self._challenge, self._challenge_due_s = self._new_challenge(), now_s + CHALLENGE_PERIOD_S
        permit = Permit(
            now_s,
            granted=granted,
            reason=self._stop_reason() or verdict.reason,
            stop_sources=record.sources,
            challenge=self._challenge,
            stop_epoch=stop.epoch,
            stop_ids=tuple(latched.stop_id for latched in record.stops),
            resumed=record.resumed,
            life=stop.life,
        )
        if changed:
            _log.info("permit granted=%s reason=%s", granted, permit.reason or "-")
            if self._permit_file is not None:
                self._permit_file.write(granted=granted)
        self._published = essence
        bus.publish(PERMIT, permit, news=changed)

    def _stop_reason(self) -> str:
        """Why no motion is granted as far as stops go, in words for people; empty where it is."""
        stop = self._stops.state
        if stop.phase is Phase.LATCHED:
            pressed = "; the button on the robot is pressed" if stop.button_pressed else ""
            return f"stopped by {', '.join(stop.record.sources)}{pressed}"
        if self._stops.trouble:
            return f"the stop record cannot be stored: {self._stops.trouble}"
        if stop.phase is not Phase.RESUMED:
            return str(stop.phase.value)
        return "" if stop.may_grant else "the stop record is being stored"

    def _report(self, bus: Bus, now_s: float, verdict: Verdict, recorder_away: bool) -> None:
        phase = self._stops.state.phase
        if phase is Phase.LATCHED:
            state, error = "STOPPED", ErrorCode.OPERATOR_STOP
        elif self._stops.trouble:
            state, error = "WAITING", ErrorCode.STOP_RECORD
        elif phase is Phase.RELEASED:
            state, error = "RELEASED", ErrorCode.OK
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
    if folder is None:
        raise StartError("comm needs --log-dir: a stop must outlive this process.")
    if BRIDGE not in config.comm.required:
        raise StartError(f'[comm] required names no "{BRIDGE}": without the bridge no permit reaches the board.')
    memory = spool_folder(folder)
    file = folder / FILE_NAME
    spool = Spool(memory, begins=not file.exists()) if memory is not None else None
    outbox = Outbox(file, config.comm.outbox_limit_mb * 1_000_000, spool=spool)
    new_challenge = (lambda: secrets.token_bytes(CHALLENGE_BYTES)) if config.mesh.keys else None
    stops = StopKeeper(folder / RECORD_NAME, life=secrets.randbits(LIFE_BITS))
    return Comm(config.comm, stops, outbox, new_challenge, permit_file(), BoardReporter(Comm.name, folder))
