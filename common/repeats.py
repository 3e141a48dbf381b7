"""Complaints that come again and again: told once a second, with how often they came. Pure."""

from __future__ import annotations

from collections import OrderedDict

_PERIOD_S = 1.0
_KEPT = 256  # different complaints; whoever makes ever new ones must not fill the memory


class Repeats:
    """Counts complaints. What was not heard of for long begins anew."""

    def __init__(self) -> None:
        self._heard: OrderedDict[str, tuple[float, int]] = OrderedDict()  # when told last, how often it came

    def count(self, complaint: str, now_s: float) -> int:
        """How often it came so far, this time too; 0 while it need not be told again."""
        told_s, count = self._heard.pop(complaint, (float("-inf"), 0))
        due = now_s - told_s >= _PERIOD_S
        self._heard[complaint] = now_s if due else told_s, count + 1
        if len(self._heard) > _KEPT:
            self._heard.popitem(last=False)
        return count + 1 if due else 0
