"""Warnings that come again and again: logged once a period, with how often they came. Pure."""

from __future__ import annotations

from collections import OrderedDict

_PERIOD_S = 1.0
_KEPT = 256  # different warnings; a sender of ever new ones must not fill the memory


class Repeats:
    """Counts each warning by its text. One that did not come for a while counts from the beginning."""

    def __init__(self, period_s: float = _PERIOD_S) -> None:
        self._period_s = period_s
        self._seen: OrderedDict[str, tuple[float, int]] = OrderedDict()  # when reported last, how often it came

    def count(self, complaint: str, now_s: float) -> int:
        """How often it came so far, this time too; 0 while it need not be logged again."""
        reported_s, count = self._seen.pop(complaint, (float("-inf"), 0))
        due = now_s - reported_s >= self._period_s
        self._seen[complaint] = now_s if due else reported_s, count + 1
        if len(self._seen) > _KEPT:
            self._seen.popitem(last=False)
        return count + 1 if due else 0
