"""What a person who looks elsewhere should be called for: the end of a mission, a robot that needs help. Pure."""

from __future__ import annotations

from common.errors import ErrorCode
from common.mission_state import ENDED
from offboard.command_center.module_watch import Freshness
from offboard.command_center.snapshot import Snapshot

# A person can end these, and the robot cannot
_HELP = frozenset(
    {
        ErrorCode.BATTERY_LOW,
        ErrorCode.CLIFF,
        ErrorCode.SERIAL_LOST,
        ErrorCode.POSE_UNCERTAIN,
        ErrorCode.BLOCKED,
        ErrorCode.STOP_RECORD,
        ErrorCode.DISK_FULL,
    }
)
QUIET_S = 30.0  # what was over for less than that and is there again is nothing new


def reasons(snapshot: Snapshot) -> dict[str, str]:
    """Sentence by what it is about, of all that is so now."""
    found = {}
    if snapshot.view is not None and snapshot.view.outcome in ENDED:
        found[snapshot.view.outcome.name] = f"The mission has ended: {ENDED[snapshot.view.outcome]}."
    for row in snapshot.rows:
        if row.freshness is Freshness.LIVE and row.status is not None and row.status.error_code in _HELP:
            meaning, action = row.error
            found[f"{row.module} {row.status.error_code}"] = f"{row.module}: {meaning} → {action}"
    return found


class Alerts:
    """`news` with every snapshot. What is so from the beginning on is no news."""

    def __init__(self) -> None:
        self._seen_s: dict[str, float] | None = None  # when each was so last

    def news(self, snapshot: Snapshot) -> list[str]:
        """The sentences of what is new."""
        now_s, found = snapshot.now_s, reasons(snapshot)
        seen_s = self._seen_s
        if seen_s is None:
            self._seen_s = dict.fromkeys(found, now_s) if snapshot.view is not None else None
            return []
        new = [text for key, text in found.items() if now_s - seen_s.get(key, float("-inf")) > QUIET_S]
        self._seen_s = seen_s | dict.fromkeys(found, now_s)
        return new
