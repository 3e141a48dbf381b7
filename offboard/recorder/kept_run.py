"""A run that is open: its database, and the files that are made from what the database holds.

All of it belongs to the thread of the disk, since any of it may take seconds; the recorder's step hands
over what is to be stored and reads what became of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from common.disk_worker import DISK_ERRORS
from common.door_names import DoorNote
from common.recording import Known, Losses, RecordedMessage, add_loss
from offboard.recorder.live_copies import LiveCopies
from offboard.recorder.outbox_rows import RowContent, unpack_rows
from offboard.recorder.run_files import RunFiles
from offboard.runs.run_schema import Delivery, RunDatabase, Summary

SUMMARY_ROWS = 10_000  # so many new messages at most are read at a restart, and those of one period of writing


@dataclass(slots=True)
class Handover:
    """What the step hands over to be stored: rows of the outbox as they travelled, and what came directly."""

    arrived_s: float
    rows: bytes = b""
    messages: list[RecordedMessage] = field(default_factory=list)
    dropped: Losses = field(default_factory=dict)
    summary: Summary | None = None
    newest_row: int | None = None  # the outbox's own number of it, once the rows are unpacked
    delivery: Delivery | None = None  # made of all this once: what the disk refused comes again


@dataclass(frozen=True, slots=True)
class RunState:
    """The run after a piece of work."""

    finished: bool  # the database holds the Planner's message that the mission is finished
    missing: int  # map points that were lost in transit
    notes: tuple[DoorNote, ...] = ()  # of doors, by a person
    statement_id: int = 0  # of the newest of that


@dataclass(frozen=True, slots=True)
class Delivered:
    """The database holds what was handed over; `refusal` is why the files do not hold its poses yet."""

    state: RunState
    newest_row: int | None  # the outbox's own number of it; None where it brought none
    problems: dict[str, str]  # topic -> newest problem of a message that cannot be decoded
    refusal: Exception | None = None


@dataclass(frozen=True, slots=True)
class Written:
    """The files are as they should be; `summary` is to be handed over with what comes next."""

    finished: bool
    summary: Summary | None = None


class KeptRun:
    """One thread at a time. Raises OSError and sqlite3.Error where the disk refuses; then everything can be repeated.

    `lost`: what became of a database that could not be gone on with. `known`: the `newest_numbers` at the opening.
    """

    def __init__(self, database: RunDatabase, files: RunFiles, copies: LiveCopies, known: Known) -> None:
        self.database, self.files, self.copies, self.known = database, files, copies, known
        self.lost = ""
        self._row = self._summary_row = 0  # the files hold the messages up to here, and a summary those up to there

    def state(self) -> RunState:
        files = self.files
        return RunState(files.finished, files.map.missing, files.notes, files.statement_id)

    def store(self, handover: Handover) -> Delivered:
        """Into the database, and from there into the files."""
        if handover.delivery is None:
            handover.delivery = self._delivery(handover)
        handover.delivery.summary = handover.summary
        result = self.database.store_data(handover.delivery)
        self._row = result.row
        if handover.summary is not None:
            self._summary_row = handover.summary.row
        for message in result.stored:
            self.files.take(message.payload)
        refusal: Exception | None = None
        try:
            self.files.append_poses()
        except DISK_ERRORS as error:
            refusal = error
        return Delivered(self.state(), handover.newest_row, result.problems, refusal)

    def write(self, *, sum_up: bool = False) -> Written:
        """Every file that is not as it should be; with a summary where it is due or requested."""
        self.files.append_poses()
        self.files.write()
        due = sum_up or self._row - self._summary_row >= SUMMARY_ROWS
        data = self.files.summary() if due else None
        return Written(self.files.finished, None if data is None else Summary(self._row, data))

    def close(self) -> None:
        self.files.close()
        self.database.close()

    def _delivery(self, handover: Handover) -> Delivery:
        content = RowContent()
        if handover.rows:
            content = unpack_rows(handover.rows)
            handover.newest_row, handover.rows = content.newest, b""
        direct = self.copies.keep(handover.messages)
        delivery = Delivery(handover.arrived_s, self.copies.complete(content.messages) + direct, content.dropped)
        for source, span in handover.dropped.items():
            add_loss(delivery.dropped, source, *span)
        return delivery
