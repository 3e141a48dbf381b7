"""Whatever takes longer than a step may is a query, and answered beside the steps (`common.side_work`).

Here is what both sides share: the form of a query, and the grids that it is answered on, which stay beside the
steps. A query names its grid by revision: a step that deliberates has one grid from the beginning to the end.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Any, Protocol, TypeVar

from common.side_work import DeferredWorker, SideWorker, Work
from onboard.planner.grid.grid_map import GridMap
from onboard.planner.grid.grid_reading import GridReader
from onboard.planner.grid.recent import RecentResults

LATENCY_S = 0.1  # of the messages' clock, in lockstep: stands for the time that an answer takes
BESIDE = "onboard.planner.grid.deliberation:load"  # what the process of the answers loads
_GRIDS_KEPT = 2  # the one that a step has, and the one that it is about to get

T = TypeVar("T")


class Grids:
    """The newest grids by revision, and what was found on them."""

    def __init__(self) -> None:
        self.reader = GridReader()
        self.recent = RecentResults()
        self._grids: dict[int, GridMap] = {}

    def put(self, revision: int, grid: GridMap) -> None:
        self._grids[revision] = grid
        for old in sorted(self._grids)[:-_GRIDS_KEPT]:
            del self._grids[old]

    def of(self, revision: int) -> GridMap:
        """Raises KeyError where there is no such grid: then the process that answers has begun anew."""
        return self._grids[revision]


class Query(Protocol):
    """A value that both sides know; it holds all that its answer depends on but the grid."""

    def answer(self, grids: Grids) -> Any:
        """However long it takes."""


Deliberation = Generator[Query, Any, T]  # yields queries, is sent their answers
Deliberator = SideWorker[Query, Any]


def load() -> Work[Query, Any]:
    """What answers queries, without any grid yet."""
    grids = Grids()
    return lambda query: query.answer(grids)


def deferred_deliberator(latency_s: float = LATENCY_S) -> DeferredWorker[Query, Any]:
    """In this very thread, for lockstep."""
    return DeferredWorker(load, latency_s)
