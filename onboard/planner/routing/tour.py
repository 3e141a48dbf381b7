"""The shortest way home past all places of a list, by the place that is visited first (Held & Karp 1962)."""

from __future__ import annotations

from common.geometry import FloatArray

PLACES_MAX = 10  # exact: the effort doubles with each


def tours_m(distance_m: FloatArray) -> list[float]:
    """By first place (N,): how long the shortest way is from here to it, through all others, to the end.

    `distance_m` (N + 2, N + 2), finite: here, up to PLACES_MAX places, the end.
    """
    d: list[list[float]] = distance_m.tolist()
    count, end = len(d) - 2, len(d) - 1
    everything = (1 << count) - 1
    # rest[todo][at]: from place `at` through all places of the set `todo` to the end
    rest = [[0.0] * count for _ in range(everything + 1)]
    for todo in range(everything + 1):
        members = [i for i in range(count) if todo >> i & 1]
        for at in range(count):
            rest[todo][at] = min(
                (d[at + 1][i + 1] + rest[todo & ~(1 << i)][i] for i in members), default=d[at + 1][end]
            )
    return [d[0][first + 1] + rest[everything & ~(1 << first)][first] for first in range(count)]
