"""Stamps of a log, from whatever clock -> times in seconds that always go on.

1. Scans with equal stamps share the time until the next stamp.
2. The unit is the one by which the robot drives about as fast as indoor robots do.
3. A few stamps that lie elsewhere, before the clock goes on, lie evenly between their neighbours. A clock that does not
   go on after that was set anew; one that stood while the scans went on continues by the log's own period.

A log whose stamps grow keeps them to the bit.
"""

from __future__ import annotations

from math import log10

import numpy as np

from common.geometry import FloatArray
from offboard.replay.log_scans import Lines, note

PERIOD_S = 0.2  # of scans without a clock
SPEED_M_S = 0.3
MOVED_M = 0.001
UNITS = {
    1.0: "seconds",
    1e-3: "milliseconds",
    1e-6: "microseconds",
    1e-9: "nanoseconds",
    1e3: "thousands of seconds",
}
GAP_MAX_S = 3600.0
STAMP_MAX_S = 1e11  # above it, seconds as floats are too coarse
WILD_MAX = 5  # scans
ELSEWHERE = "a stamp that lies elsewhere was put between its neighbours"
STOOD_SHARE = 0.3  # of the log's period: scans that share less time than this were not that close


def steady(stamps: FloatArray, steps_m: FloatArray, lines: Lines, notes: list[str]) -> FloatArray:
    """Times (N,) in seconds, each later than the one before, of stamps (N,) with ways (N - 1,) between; adds notes."""
    firsts = np.flatnonzero(np.diff(stamps, prepend=np.nan) != 0)
    counts = np.diff(firsts, append=len(stamps))
    unit_s = _unit_s(stamps[firsts], counts, steps_m)
    if unit_s != 1.0:
        notes.append(f"the stamps were taken for {UNITS[unit_s]}: in seconds the robot would not drive as robots do")
    values = stamps[firsts] * unit_s
    gaps_s = np.diff(values) / counts[:-1]
    gaps_s = gaps_s[(gaps_s > 0) & (gaps_s <= GAP_MAX_S)]
    period_s = float(np.median(gaps_s)) if len(gaps_s) else PERIOD_S
    first = _first(values, counts)
    note(notes, lines[: firsts[first]].tolist(), ELSEWHERE)
    kept, times_s = _walk(values[first:], counts[first:], period_s, lines[firsts[first:]], notes)
    starts = firsts[first:][kept]
    shares = np.diff(starts, append=len(stamps))
    ends_s = np.append(times_s[1:], times_s[-1] + shares[-1] * period_s)
    place = np.arange(starts[0], len(stamps)) - np.repeat(starts, shares)
    rest_s = np.repeat(times_s, shares) + place * np.repeat((ends_s - times_s) / shares, shares)
    return np.concatenate([rest_s[0] - period_s * np.arange(starts[0], 0, -1), rest_s])


def _first(values: FloatArray, counts: Lines) -> int:
    """The first stamp that the clock goes on from; the very first where it soon goes on from none."""
    for k in range(min(WILD_MAX, len(values) - 1)):
        if _goes_on(values, k, k + 1) or _back(values, counts, k, k + 1):
            return k
    return 0


def _unit_s(values: FloatArray, counts: Lines, steps_m: FloatArray) -> float:
    gaps = np.diff(values) / counts[:-1]
    gaps, moved_m = gaps[gaps > 0], steps_m[steps_m > MOVED_M]
    if not len(gaps) or not len(moved_m):
        return 1.0
    speed = float(np.median(moved_m)) / float(np.median(gaps))
    return min(UNITS, key=lambda unit_s: abs(log10(speed / unit_s / SPEED_M_S)))


def _walk(
    values: FloatArray, counts: Lines, period_s: float, lines: Lines, notes: list[str]
) -> tuple[Lines, FloatArray]:
    """Which of the stamps (G,), each of `counts` scans, are believed, and the times of their first scans."""
    stamps = values.tolist()
    kept, runs = [0], abs(stamps[0]) <= STAMP_MAX_S
    times_s = [stamps[0] if runs else 0.0]
    wild, anew, stood = [], [], []
    at = 1
    while at < len(stamps):
        last = kept[-1]
        step_s = stamps[at] - stamps[last]
        due_s = float(counts[last:at].sum()) * period_s
        if not _goes_on(values, last, at):
            back = _back(values, counts, last, at)
            if back:
                wild += lines[at:back].tolist()
                at = back
                continue
            anew.append(int(lines[at]))
            step_s, runs = due_s, False
        elif counts[last] > 1 and step_s < STOOD_SHARE * due_s:
            stood.append(int(lines[last]))
            step_s, runs = due_s, False
        kept.append(at)
        times_s.append(stamps[at] if runs else times_s[-1] + step_s)
        at += 1
    if counts[-1] > max(WILD_MAX, int(counts[:-1].max(initial=1))):
        stood.append(int(lines[-1]))
    note(notes, wild, ELSEWHERE)
    note(notes, anew, "the clock was set anew; times go on from the scan before")
    note(notes, stood, f"the clock stands still; scans follow each other every {period_s:.3g} s from there on")
    return np.array(kept), np.array(times_s)


def _goes_on(values: FloatArray, last: int, at: int) -> bool:
    return bool(0 < values[at] - values[last] <= GAP_MAX_S)


def _back(values: FloatArray, counts: Lines, last: int, at: int) -> int:
    """Where soon after `at` the clock goes on from the `last` stamp that is believed; 0 where it does not."""
    for k in range(at + 1, min(at + 1 + WILD_MAX, len(values))):
        if _goes_on(values, last, k):
            return k if counts[at:k].sum() <= WILD_MAX else 0
    return 0
