"""What the planner knows of the floor: map, judged grid and distances from the bus, answers to its queries.

One grid is judged at a time, and a deliberation keeps the grid that it began with: a newer one waits until it is over.
"""

from __future__ import annotations

import logging
import math
from collections import deque

from common.bus import Bus
from common.messages.mapping import GridUpdate, PoseEstimate
from common.messages.topics import DISTANCES, GRID, MAP, POSE
from common.undecodable import Undecodable
from common.wall_points import WallPointMap
from onboard.planner.exploration.queries import JudgedGrid
from onboard.planner.grid.deliberation import Deliberator, Query
from onboard.planner.grid.grid_map import GridMap
from onboard.planner.grid.grid_reading import GridError
from onboard.planner.grid.view import View
from onboard.planner.mission.mission import Mission
from onboard.planner.routing.home_distance import HomeDistance
from onboard.planner.zones.zone_keeper import ZoneKeeper

_log = logging.getLogger(__name__)


class KnownFloor:
    """`grid` is the newest one that was judged; `home_m` how far home is (metres), by the newest answer."""

    def __init__(self, deliberator: Deliberator, mission: Mission, zones: ZoneKeeper) -> None:
        self._deliberator, self._zones = deliberator, zones
        self._pending, self._frontiers = mission.pending, mission.frontiers
        self._queried: deque[Query] = deque()  # in the order of their answers
        self._undecodable = Undecodable()
        self._zones_read = -1  # their revision in the newest grid
        self._grid_update: GridUpdate | None = None  # the newest
        self._update_read: GridUpdate | None = None  # of the newest query
        self._next_grid: JudgedGrid | None = None  # was read
        self._revision_queried = 0
        self.grid: GridMap | None = None
        self.grid_revision = 0
        self.home_m = 0.0
        self._points = WallPointMap()
        self._left: deque[float] = deque(maxlen=5)
        self._right: deque[float] = deque(maxlen=5)
        self._front: deque[float] = deque(maxlen=3)

    def receive(self, bus: Bus, now_s: float) -> bool:
        """Takes what has come; whether the mission got an answer that it waited for."""
        answered = self._take_answers(now_s)
        self._take_map(bus, now_s)
        for distances in bus.take(DISTANCES):
            self._left.append(distances.left_m)
            self._right.append(distances.right_m)
            self._front.append(distances.front_m)
        return answered

    def query(self, query: Query | None, now_s: float) -> None:
        """Has a query answered beside the steps, after those before it."""
        if query is not None:
            self._queried.append(query)
            self._deliberator.begin(query, now_s)

    def query_home_distance(self, now_s: float, pose: PoseEstimate) -> None:
        """Where the answer can be had: it is `home_m` some steps later."""
        if self.grid is not None and not self._deliberator.busy:
            self.query(HomeDistance(self.grid_revision, pose.pose), now_s)

    def due_s(self, now_s: float) -> float:
        """When an answer may be there (s)."""
        return self._deliberator.due_s(now_s)

    def close(self) -> None:
        self._deliberator.close()

    def view(self, now_s: float, pose: PoseEstimate) -> View:
        assert self.grid is not None
        return View(
            now_s,
            pose.pose,
            self.grid,
            self.grid_revision,
            self._points,
            _median(self._left),
            _median(self._right),
            _median(self._front),
        )

    def _take_map(self, bus: Bus, now_s: float) -> None:
        for update in bus.take(MAP):
            self._points.apply(update)
        for grid in bus.take(GRID)[-1:]:
            self._grid_update = grid
        newest, pose = self._grid_update, bus.latest(POSE)
        if newest is None or pose is None or self._deliberator.busy or self._pending.open:
            return  # one at a time; and a deliberation keeps its grid
        if newest is self._update_read and self._zones_read == self._zones.revision:
            return
        self._update_read, self._zones_read = newest, self._zones.revision
        self._revision_queried += 1
        self.query(self._frontiers.query(self._revision_queried, pose.pose, newest, self._zones.zones), now_s)

    def _take_answers(self, now_s: float) -> bool:
        answered = False
        while (outcome := self._deliberator.result(now_s)) is not None:
            query, answer = self._queried.popleft(), outcome.value
            if outcome.error is not None:
                self._begin_deliberating_anew(outcome.error)
            elif isinstance(answer, GridError):
                self._undecodable.count(GRID.key, str(answer))
            elif isinstance(query, HomeDistance):
                self.home_m = self.home_m if answer is None else answer
            elif isinstance(answer, JudgedGrid) and answer.grid is not None:
                self._next_grid = answer
            else:
                self._pending.receive(query, answer)
                answered = True
        judged = self._next_grid
        if judged is not None and not self._pending.open:
            self._next_grid, self.grid, self.grid_revision = None, judged.grid, judged.revision
            self._frontiers.take_in(judged)
        return answered

    def _begin_deliberating_anew(self, error: Exception) -> None:
        """What answers has lost the grids: the robot stands until the next one was read."""
        _log.error("deliberation: %s", error)
        self._pending.abandon()
        self.grid = self._next_grid = None


def _median(values: deque[float]) -> float:
    """Of those with an echo; NaN where most were not."""
    known = sorted(v for v in values if v == v)
    return known[len(known) // 2] if len(known) > len(values) // 2 else math.nan
