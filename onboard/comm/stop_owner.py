"""May the robot move again after a stop? Comm's state machine of stop, release and resume. Pure.

    latched --release(epoch)--> released --resume(epoch)--> resumed
       ^                           |                           |
       +---------- a press: epoch + 1, from any of them -------+

A press acts at once and is stored afterwards; a release or resume acts only once it is stored. So after a latched stop
nothing moves before a release and a resume of its epoch, whatever crashes or loses power, at any moment.

A record that is missing or damaged counts as a stop. After a restart the bridge reports which epochs it and the board
know (`BridgeReport`). Where one is newer, the record is too old; where the bridge was restarted as well, as after every
power cut, a stop may have acted that was not stored. Both count as a stop, and a stop that is latched over a restart
gets a new epoch, higher than every epoch that was ever given out. A press that reached only a comm which died with it
is not confirmed, so its sender sends it again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

from onboard.comm.stop_record import Stop, StopRecord

LOST_RECORD = "lost record"  # source of the stop after a restart without a valid record: there may have been a stop
RESTART = "restart"
EPOCHS_LOST_MAX = 1000  # as many may have been given out and never stored


class Phase(Enum):
    """What is missing before the robot may move, as far as stops go; the value is for people."""

    LATCHED = "stopped"
    QUERYING = "the bridge has not reported yet which stop it knows"
    RELEASED = "released, waiting for a resume"
    RESUMED = "no stop"


@dataclass(frozen=True, slots=True)
class BridgeReport:
    """What the bridge reports of stops."""

    life: int  # of the comm whose permit it answers
    bridge_epoch: int  # the newest that it received in a permit, 0 = none since its start
    board_epoch: int
    stops: tuple[Stop, ...] = ()  # that no permit has quoted
    button_pressed: bool = False


@dataclass(frozen=True, slots=True)
class StopOwner:
    """One state. `record` is in force, `wanted` is what the disk shall hold next, `durable` what it holds.

    `wanted` differs from `record` while something that lets the robot move waits for the disk. `queried` is the record
    as it was loaded, until the bridge has answered.
    """

    life: int
    record: StopRecord
    wanted: StopRecord
    durable: StopRecord | None
    queried: StopRecord | None
    button_pressed: bool = False

    @property
    def phase(self) -> Phase:
        if self.record.latched:
            return Phase.LATCHED
        if self.queried is not None:
            return Phase.QUERYING
        return Phase.RESUMED if self.record.resumed else Phase.RELEASED

    @property
    def epoch(self) -> int:
        """The epoch in the permit: 0 until the bridge has reported, or it would report back what it just received."""
        return self.record.epoch if self.queried is None else 0

    @property
    def to_store(self) -> StopRecord | None:
        return None if self.wanted == self.durable else self.wanted

    @property
    def may_grant(self) -> bool:
        """As far as stops go; never while the disk holds something else."""
        return self.phase is Phase.RESUMED and self.durable == self.record


def owner(loaded: StopRecord | None, life: int) -> StopOwner:
    """At the start of comm. `loaded`: None for a record that is missing or damaged; `life`: another one each time."""
    queried = loaded or StopRecord(0, (Stop(LOST_RECORD, life),), resumed=False)
    record = replace(queried, used=True)
    return StopOwner(life, record, record, loaded, queried)


def press(state: StopOwner, stop: Stop) -> StopOwner:
    """In force at once; what waited for the disk to let the robot move is dropped."""
    return _in_force(state, state.record.pressed(stop))


def release(state: StopOwner, epoch: int) -> StopOwner:
    """By a person who names what is released; nothing changes while the robot's own button is pressed."""
    return state if state.button_pressed else _once_stored(state, state.record.released(epoch))


def resume(state: StopOwner, epoch: int) -> StopOwner:
    """By a person who names the stop after which the robot may go on."""
    return _once_stored(state, state.record.resumed_after(epoch))


def on_report(state: StopOwner, report: BridgeReport) -> StopOwner:
    """The bridge's newest report."""
    if state.button_pressed != report.button_pressed:
        state = replace(state, button_pressed=report.button_pressed)
    if state.queried is not None and report.life == state.life:
        state = _answered(state, state.queried, report)
    for stop in report.stops:
        state = press(state, stop)
    return state


def stored(state: StopOwner, record: StopRecord) -> StopOwner:
    """The disk holds `record` now."""
    state = replace(state, durable=record)
    return replace(state, record=record) if record == state.wanted else state


def _in_force(state: StopOwner, record: StopRecord) -> StopOwner:
    return replace(state, record=record, wanted=record)


def _once_stored(state: StopOwner, wanted: StopRecord) -> StopOwner:
    if state.queried is not None or wanted == state.record:
        return state
    return replace(state, wanted=wanted)


def _answered(state: StopOwner, loaded: StopRecord, report: BridgeReport) -> StopOwner:
    state = replace(state, queried=None)
    known_epoch = max(report.bridge_epoch, report.board_epoch)
    too_old = known_epoch > loaded.epoch
    nobody_knows = report.bridge_epoch == 0 and loaded.used
    record = state.record
    if too_old or nobody_knows:
        record = record.pressed(Stop(RESTART, state.life))
    if record.latched:
        record = replace(record, epoch=max(record.epoch, known_epoch) + EPOCHS_LOST_MAX)
    return _in_force(state, record)
