"""What was made of doors of hard looks: drives in, a table of what was found and what is no door out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from offboard.evaluate.doors.drive import Passed
from offboard.evaluate.doors.walls import Look


def found_share(drives: Sequence[Passed]) -> float:
    """Of all doors that were passed."""
    found, missed = sum(len(d.found) for d in drives), sum(len(d.missed) for d in drives)
    return found / max(found + missed, 1)


def false_share(drives: Sequence[Passed]) -> float:
    """Of all records."""
    found, false = sum(len(d.found) for d in drives), sum(len(d.false_m) for d in drives)
    return false / max(found + false, 1)


def door_table(drives: Sequence[Passed]) -> list[str]:
    """Lines for people, by look."""
    lines = [f"{'':16}   doors   found   records   false"]
    for name, some in (*((look.value, [d for d in drives if d.look is look]) for look in Look), ("all", drives)):
        doors = sum(len(d.found) + len(d.missed) for d in some)
        records = sum(len(d.found) + len(d.false_m) for d in some)
        if doors:
            shares = 100 * found_share(some), 100 * false_share(some)
            lines.append(f"{name:16} {doors:7} {shares[0]:6.1f}% {records:9} {shares[1]:6.1f}%")
    beside = Counter(other for drive in drives if drive.false_m for other in set(drive.others))
    lines.append("walls with a false record have: " + ", ".join(f"{what} {n}" for what, n in beside.most_common()))
    return lines
