"""The software stop that the robot owns: who holds it, and how that outlives a restart. Pure but for the two functions
at the end, which read and write the record.

It stands while any source holds it. Release is per source and deliberate; it never starts motion by itself (CAR, CC:
decision 20).
"""

from __future__ import annotations

import json
import logging
from dataclasses import dataclass
from pathlib import Path

from common.messages import StopRequest

RECORD_NAME = "stop_latch.json"  # in the log folder of comm
UNREADABLE = "operator"  # who is taken to hold a stop whose record cannot be read: what people can release

_log = logging.getLogger("comm")


@dataclass(frozen=True, slots=True)
class StopLatch:
    sources: frozenset[str] = frozenset()

    def after(self, request: StopRequest) -> StopLatch:
        """The latch once a request was heard. Any request stops; only one that its sender stands behind releases."""
        if request.latched:
            return StopLatch(self.sources | {request.source})
        return StopLatch(self.sources - {request.source}) if request.valid else self


def load_latch(record: Path) -> StopLatch:
    """The latch as it was before the restart; a record that cannot be read counts as a stop."""
    if not record.exists():
        return StopLatch()
    try:
        sources = json.loads(record.read_text(encoding="utf-8"))
        return StopLatch(frozenset(str(s) for s in sources))
    except (OSError, ValueError, TypeError) as error:
        _log.warning("stop record unreadable, counts as a stop file=%s error=%s", record, error)
        return StopLatch(frozenset({UNREADABLE}))


def save_latch(record: Path, latch: StopLatch) -> None:
    """Replaces the record in one move; a disk that refuses must not keep the stop from working."""
    try:
        part = record.with_suffix(".part")
        part.write_text(json.dumps(sorted(latch.sources)), encoding="utf-8")
        part.replace(record)
    except OSError as error:
        _log.warning("stop record not written file=%s error=%s", record, error)
