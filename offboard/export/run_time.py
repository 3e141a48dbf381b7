"""One time for all messages of a run: each sender has a clock of its own, and stored messages may arrive late.

A sender's clock is put onto the recorder's by the message of it that took the shortest time to arrive; the recorder's
onto wall time by the date at which it began. A run in lockstep has no date: its time begins in 1970.
"""

from __future__ import annotations

from math import inf

from offboard.runs.run_database import Message, RunReader

NS = 1_000_000_000
NEWEST_S = 2.0**31 - 1.0  # ROS counts seconds in 31 bits


class RunTime:
    def __init__(self, run: RunReader) -> None:
        self._ahead_s: dict[tuple[str, int], float] = {}
        for (key, boot_id), delay_s in run.least_delays_s().items():
            sender = key.split("/")[0], boot_id
            self._ahead_s[sender] = min(self._ahead_s.get(sender, inf), delay_s)
        dates = run.dates()
        self._date_s = dates[0].timestamp() - run.begin_s() if dates else 0.0

    def of(self, message: Message[object]) -> int:
        """When its content was measured: nanoseconds since 1970."""
        return self.at(message, message.payload.t_s)  # type: ignore[attr-defined]

    def at(self, message: Message[object], t_s: float) -> int:
        """Another time on the clock of its sender."""
        ahead_s = self._ahead_s.get((message.topic.producer, message.boot_id), 0.0)
        return round(min(max(self._date_s + ahead_s + t_s, 0.0), NEWEST_S) * NS)
