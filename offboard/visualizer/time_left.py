"""When the robot will be home, roughly: way that is left, by how fast it got on so far. Plan and poses in. Pure.

What is left of an exploration is not known: it is taken for as much way per open hall as there was per hall so far, and
the way home. Halls that were found later made it longer, so it is no promise. Times are the robot's.
"""

from __future__ import annotations

from collections import deque
from itertools import pairwise
from math import hypot

from common.messages.mapping import PoseEstimate
from common.messages.mission import PlannerView
from common.mission_state import Stage, mission_state

PACE_S = 180.0  # over which the speed is taken, with all looks and turns
_STEP_S = 1.0
_PATH_PER_HALL_M = 12.0  # before the first hall is done
_DETOUR = 1.4  # the way home over the straight line there


class TimeLeft:
    """`take` plan and pose as they come."""

    def __init__(self) -> None:
        self._driven_m = 0.0
        self._place: tuple[float, float] | None = None
        self._paced: deque[tuple[float, float]] = deque()  # time, way until then
        self._plan: PlannerView | None = None
        self._began_m: float | None = None  # way driven when the exploration began
        self._halls_done = 0

    def take_pose(self, pose: PoseEstimate) -> None:
        place = pose.x_m, pose.y_m
        if self._place is not None:
            self._driven_m += hypot(place[0] - self._place[0], place[1] - self._place[1])
        self._place = place
        if self._paced and pose.t_s < self._paced[-1][0]:
            self._paced.clear()  # a robot that was restarted
        if not self._paced or pose.t_s - self._paced[-1][0] >= _STEP_S:
            self._paced.append((pose.t_s, self._driven_m))
        while pose.t_s - self._paced[0][0] > PACE_S:
            self._paced.popleft()

    def take_plan(self, plan: PlannerView) -> None:
        if self.stage(plan) is Stage.EXPLORE:
            if self._began_m is None:
                self._began_m, self._halls_done = self._driven_m, 0
            elif self._plan is not None:
                self._halls_done += max(0, self._plan.halls_open - plan.halls_open)
        self._plan = plan

    @staticmethod
    def stage(plan: PlannerView) -> Stage:
        return mission_state(plan, None).stage

    @property
    def speed_m_s(self) -> float | None:
        """Mean of PACE_S; None before there is any."""
        if len(self._paced) < 2:
            return None
        (begin_s, begin_m), (end_s, end_m) = self._paced[0], self._paced[-1]
        return (end_m - begin_m) / (end_s - begin_s)

    @property
    def seconds(self) -> float | None:
        """None where nothing is under way, or nobody can tell."""
        plan, place, speed = self._plan, self._place, self.speed_m_s
        if plan is None or place is None or not speed or plan.paused:
            return None
        stage = self.stage(plan)
        left_m = _length_m([place, *plan.path_m.tolist()])
        if stage is Stage.EXPLORE:
            goal = tuple(plan.path_m[-1].tolist()) if len(plan.path_m) else place
            left_m += plan.halls_open * self._path_per_hall_m + _DETOUR * hypot(*goal)
        elif stage is not Stage.RETURN:
            return None
        return left_m / speed

    @property
    def _path_per_hall_m(self) -> float:
        if not self._halls_done or self._began_m is None:
            return _PATH_PER_HALL_M
        return (self._driven_m - self._began_m) / self._halls_done


def _length_m(places: list[tuple[float, float]]) -> float:
    return sum(hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(places))
