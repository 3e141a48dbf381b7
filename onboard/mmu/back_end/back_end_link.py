"""What connects the front end to the back end: hands over what is new every half metre, and collects corrections."""

from __future__ import annotations

import logging
from math import inf

import numpy as np

from common.side_work import SideWorker
from onboard.mmu.back_end.exchange import Correction, Increment
from onboard.mmu.map.keyframe_map import Counts, KeyframeMap
from onboard.mmu.map.keyframes import LastSeen

HAND_OVER_M = 0.5  # of path; the sensitivity was not measured

BackEndWorker = SideWorker[Increment, Correction]

_log = logging.getLogger("mmu")


class BackEndLink:
    """`prior`: what the keyframe map held before this run, which is handed over first, as a prior map."""

    def __init__(self, worker: BackEndWorker, keyframes: KeyframeMap) -> None:
        self._worker = worker
        self._keyframes = keyframes
        self._handed = Counts()  # what the back end has
        self._handed_path_m = 0.0
        self._ranges_to_wall: list[tuple[float, ...]] = []  # that the back end does not have
        self.prior = Counts()

    @property
    def submitted(self) -> Counts:
        """What the next correction rests on."""
        return self._handed

    def begin_with_prior(self) -> None:
        """All that the keyframe map holds is a prior map, and the back end has none of it."""
        self.prior = self._keyframes.counts
        self._handed, self._handed_path_m = Counts(), -inf

    def add_range_to_wall(self, row: tuple[float, ...]) -> None:
        """A row of `Increment.ranges_to_wall`."""
        self._ranges_to_wall.append(row)

    def collect(self, now_s: float) -> Correction | None:
        outcome = self._worker.result(now_s)
        if outcome is None or outcome.value is not None:
            return outcome.value if outcome is not None else None
        _log.error("%s: it is given everything again", outcome.error)
        return Correction.lost()

    def due(self, path_m: float) -> bool:
        """Is the path since the last hand-over long enough, and the back end ready for the next?"""
        return path_m - self._handed_path_m >= HAND_OVER_M and not self._worker.busy

    def hand_over(self, now_s: float, path_m: float, last: LastSeen | None) -> None:
        """What is new; `last`: where the robot is."""
        self._handed_path_m = path_m
        start, prior_map = self._handed, self._handed.keyframes < self.prior.keyframes
        end = self.prior if prior_map else self._keyframes.counts
        self._handed = end
        increment = Increment(
            tuple(self._keyframes.keyframes[start.keyframes : end.keyframes]),
            self._keyframes.echoes.rows(start.echoes, end.echoes),
            self._keyframes.rays.rows(start.rays, end.rays),
            last,
            prior_map,
            np.array([] if prior_map else self._ranges_to_wall).reshape(-1, 8),
        )
        if not prior_map:
            self._ranges_to_wall = []
        self._worker.begin(increment, now_s)

    def close(self) -> None:
        self._worker.close()
