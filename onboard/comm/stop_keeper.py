"""The stop owner with its disk. The disk has a thread of its own: a stop is in the permit before it is in the file."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

from common.disk_worker import disk_worker
from onboard.comm import stop_owner
from onboard.comm.stop_owner import StopOwner
from onboard.comm.stop_record import DamagedRecord, StopRecord, read_record, write_record

RETRY_S = 1.0  # after the disk refused
LOOK_S = 0.02  # between two looks whether the disk is done

_log = logging.getLogger("comm")


class StopKeeper:
    """Part of comm. Without a file it forgets, for lockstep and tests, and begins as a robot that was never stopped."""

    def __init__(self, file: Path | None, life: int = 1) -> None:
        """`life`: another number after each restart."""
        self._file = file
        self._disk = disk_worker("stop", at_once=file is None)
        self._retry_s = float("-inf")
        self.trouble = ""  # why the disk does not take the record
        self.state: StopOwner = stop_owner.owner(_load(file) if file is not None else StopRecord(), life)
        # Stored before any message is received: if this process dies with a stop that acted and was not stored, the
        # record then shows that one may be missing
        wanted = self.state.to_store
        if wanted is not None:
            try:
                self._took(self._store(wanted))
            except OSError as error:
                self._refused(error)

    def change(self, after: Callable[[StopOwner], StopOwner]) -> None:
        """One event, as a function of `stop_owner`."""
        self._become(after(self.state))

    def step(self, now_s: float) -> None:
        """Takes the outcome of the last write, and starts the next one where the record has changed."""
        outcome = self._disk.result(now_s)
        if outcome is not None and outcome.error is not None:
            self._refused(outcome.error)
            self._retry_s = now_s + RETRY_S
        elif outcome is not None and outcome.value is not None:
            self._took(outcome.value)
        wanted = self.state.to_store
        if wanted is not None and not self._disk.busy and now_s >= self._retry_s:
            self._disk.begin(lambda: self._store(wanted), now_s)

    def due_s(self, now_s: float) -> float:
        """When `step` has something to do (s): while the disk writes soon, for the permit may wait for it."""
        if self._disk.busy:
            return now_s + LOOK_S
        return max(now_s, self._retry_s) if self.state.to_store is not None else float("inf")

    def close(self) -> None:
        """Waits for what is being stored."""
        self._disk.close()

    def _store(self, record: StopRecord) -> StopRecord:
        if self._file is not None:
            write_record(self._file, record)
        return record

    def _took(self, record: StopRecord) -> None:
        self.trouble = ""
        self._become(stop_owner.stored(self.state, record))

    def _refused(self, error: Exception) -> None:
        self.trouble = getattr(error, "strerror", None) or str(error)
        _log.error("stop record not stored file=%s error=%s", self._file, self.trouble)

    def _become(self, state: StopOwner) -> None:
        before, self.state = self.state, state
        if (state.phase, state.record.epoch) != (before.phase, before.record.epoch):
            sources = ",".join(state.record.sources) or "-"
            _log.info("stop phase=%s epoch=%d sources=%s", state.phase.name, state.record.epoch, sources)


def _load(file: Path) -> StopRecord | None:
    """None, which counts as a stop, for a record that is missing or cannot be read."""
    try:
        record = read_record(file)
    except (OSError, DamagedRecord) as error:
        _log.warning("stop record cannot be read, which counts as a stop: %s", error)
        return None
    if record is None:
        _log.warning("no stop record, which counts as a stop file=%s", file)
    return record
