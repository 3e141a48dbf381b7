"""What a person who looks elsewhere should be called for: the end of a mission, a robot that needs help. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from common.errors import ERRORS, ErrorCode, ErrorInfo
from common.messages.mission import PlannerView
from common.mission_state import ENDED

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
_UNKNOWN = ErrorInfo("an error that this version does not know", "bring both sides to the same version")
QUIET_S = 30.0  # what was over for less than that and is there again is nothing new


def error_info(code: int) -> ErrorInfo:
    """Meaning of an error code and what to do about it; also of one that this program does not know."""
    try:
        return ERRORS[ErrorCode(code)]
    except ValueError:
        return _UNKNOWN


def reasons(view: PlannerView | None, errors: Iterable[tuple[str, int]]) -> dict[str, str]:
    """Sentence by what it is about, of all that is so now; `errors`: module and error code of each newest report."""
    found = {}
    if view is not None and view.outcome in ENDED:
        found[view.outcome.name] = f"The mission has ended: {ENDED[view.outcome]}."
    for module, code in errors:
        if code in _HELP:
            info = error_info(code)
            found[f"{module} {code}"] = f"{module}: {info.meaning} → {info.action}"
    return found


class Alerts:
    """`news` with everything that is so now. What is so from the beginning on is no news."""

    def __init__(self) -> None:
        self._seen_s: dict[str, float] | None = None  # when each was so last

    def news(self, found: Mapping[str, str], now_s: float, *, known: bool) -> list[str]:
        """The sentences of what is new; `known`: how the mission stands is."""
        seen_s = self._seen_s
        if seen_s is None:
            self._seen_s = dict.fromkeys(found, now_s) if known else None
            return []
        new = [text for key, text in found.items() if now_s - seen_s.get(key, float("-inf")) > QUIET_S]
        self._seen_s = seen_s | dict.fromkeys(found, now_s)
        return new
