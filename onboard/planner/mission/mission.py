"""The mission: explore by the right-hand rule and the list of side halls, come home, stop.

Its `step` takes pose, grid, wall points and distances ten times a second and returns the motion that it wants. What was
seen and chosen becomes an event; `table` alone decides which mode follows. What takes longer than a step, a path for
example, is a query: it goes out by `pending.take`, its answer comes by `pending.receive`, and until then the robot
stands, or goes on with its leg.
"""

from __future__ import annotations

from dataclasses import replace
from math import atan2, cos, inf, pi, sin

from common.geometry import Pose2, wrap_angle
from common.messages.motion import Speed
from onboard.planner.driving.hall_following import HallFollowing
from onboard.planner.driving.looking import HEADING_REACHED_RAD, TURN_TIMEOUT_S, Looking
from onboard.planner.exploration import frontiers
from onboard.planner.exploration.frontier_manager import FrontierManager
from onboard.planner.exploration.recovery_memory import STAGNANT_S, Stillness
from onboard.planner.exploration.wall_imaging import WallImaging
from onboard.planner.grid.deliberation import Deliberation
from onboard.planner.grid.grid_map import Cell
from onboard.planner.grid.view import Motion, View
from onboard.planner.mission import hindrances
from onboard.planner.mission.goal_choice import Goal, GoalChoice
from onboard.planner.mission.leg import Leg
from onboard.planner.mission.pending import Pending
from onboard.planner.mission.state_log import StateLog
from onboard.planner.mission.table import (
    AT_REST,
    BLOCKED,
    GOING_HOME,
    GOING_TO_PLACE,
    ON_LEG,
    VISITING,
    Event,
    Mode,
    State,
    Step,
)
from onboard.planner.routing import destination
from onboard.planner.routing.path_following import Path, arrived, rest_of, speed_along

BLOCK_AHEAD_M = 0.45


class Mission:
    """`step` returns the wanted motion; `log` and `path` show people what it does."""

    def __init__(self, images_walls: bool = False) -> None:
        """`images_walls`: there is a camera, and every wall shall have been on its right."""
        self.log = StateLog()  # state, and what is to be logged
        self.path: Path = []
        self.pending = Pending()  # a choice or a path
        self.frontiers = FrontierManager()  # what the grids offer
        self._hall = HallFollowing()
        self._looking = Looking()
        self._target: tuple[float, float] = (0.0, 0.0)
        self._now_s = -inf
        self._stillness = Stillness()
        self._imaging = WallImaging() if images_walls else None
        self._choice = GoalChoice(self.frontiers, self._hall, self._imaging)
        self._leg = Leg(self.frontiers, self._hall, self._imaging)
        self._wall_rad = 0.0  # heading for the next leg along a wall
        self._wall_due = False  # that leg comes next
        self._obstacles, self._patience = hindrances.ObstaclesMet(), hindrances.PathPatience()
        self._retake_rad = 0.0
        self._align_until_s = 0.0

    @property
    def state(self) -> State:
        return self.log.state

    @property
    def mode(self) -> Mode:
        """What it is doing."""
        return self.state.mode

    def replan(self) -> None:
        """What it was about to drive along may not be open to it any more, or not be all that is open."""
        self.path = []
        self.pending.abandon()
        self.frontiers.judge_anew()

    def order(self, event: Event, place_m: tuple[float, float] = (0.0, 0.0)) -> Step:
        """What an operator or the permit wants of it; `place_m` in the map is where a goto leads."""
        self._patience.renew()
        step = self._happens(event, f"place={place_m[0]:.2f},{place_m[1]:.2f}" if event is Event.GO_TO else "")
        if event is Event.GO_TO:
            self._target = place_m
        return step

    def start(self, pose: Pose2, now_s: float) -> Step:
        """Begin to explore; once more from the beginning of the list after a mission that has ended."""
        step = self.order(Event.START)
        if not step.refused:
            self.log.leave_out(())
            self.frontiers.renew_patience()
            self._looking.begin(pose.heading_rad, now_s)
        return step

    def detour(self, pose: Pose2) -> None:
        """Stand at a pose for another photo, then go on exploring."""
        self._happens(Event.DETOUR, f"place={pose.x_m:.2f},{pose.y_m:.2f}")
        if self.mode is Mode.RETAKE:
            self._target, self._retake_rad = (pose.x_m, pose.y_m), pose.heading_rad

    def end_detour(self, heading_rad: float, now_s: float) -> None:
        """That photo is no longer wanted: explore again."""
        if self.mode is Mode.RETAKE:
            self._look(Event.DETOUR_OVER, heading_rad, now_s)

    def blocked(self, view: View, bearing_rad: float) -> None:
        """An obstacle stands there that the map does not know: plan around it for a while."""
        angle = view.pose.heading_rad + bearing_rad
        x_m, y_m = view.pose.x_m + BLOCK_AHEAD_M * cos(angle), view.pose.y_m + BLOCK_AHEAD_M * sin(angle)
        self.frontiers.meet(x_m, y_m, view.now_s)
        self.log.note(f"obstacle place={x_m:.2f},{y_m:.2f} frontier there deferred")
        if self.mode in ON_LEG:
            self._end_leg(view)
        elif self.mode in VISITING and self._obstacles.block_target(self._target, (x_m, y_m)):
            self._defer(view, f"{hindrances.OBSTRUCTIONS_MAX} obstacles in the way")
        self.path = []
        self.pending.abandon()
        if self._obstacles.meet(view.pose) and self.mode in (Mode.HOME, Mode.GOTO):
            self._wait_for_path(view, (0.0, 0.0) if self.mode is Mode.HOME else self._target)

    def step(self, view: View) -> Motion:
        """The motion that is wanted now."""
        dt_s, self._now_s = view.now_s - self._now_s, view.now_s
        self.frontiers.forget(view.now_s)
        self.frontiers.trail.drive(view.pose)
        if self._imaging is not None:
            self._imaging.look(view.grid, view.pose)
        return self._act(view, dt_s)

    def _act(self, view: View, dt_s: float) -> Motion:
        stand = Motion(Speed.STOP, view.pose.heading_rad)
        if self._stillness.stagnates(view.pose, dt_s, under_way=self.mode in VISITING):
            self._defer(view, f"no motion for {STAGNANT_S:.0f} s")
            self.frontiers.judge_anew()
            return stand
        if self.mode in AT_REST or (self.pending.open and self.mode not in ON_LEG):
            return stand
        if self.mode is Mode.LOOK:
            return self._stand_and_look(view)
        if self.mode in ON_LEG:
            return self._drive_leg(view)
        if self.mode is Mode.ALIGN:
            if abs(wrap_angle(view.pose.heading_rad)) < HEADING_REACHED_RAD or view.now_s > self._align_until_s:
                self._happens(Event.ALIGNED)
            return Motion(Speed.STOP, 0.0)
        if self.mode in BLOCKED:
            if self._patience.retries(view.now_s):
                self.pending.begin(self._plan_path(view))
            return stand
        return self._follow_path(view)

    def _happens(self, event: Event, why: str = "") -> Step:
        """Take the step of the table; a path belongs to the mode that planned it."""
        step = self.log.happens(event, why)
        if step.moves:
            self.path, self._wall_due = [], False
            self.pending.abandon()
        return step

    def _defer(self, view: View, why: str) -> None:
        """Leave the place that it is driving to for the second try, and the wall there for good."""
        x_m, y_m = self._target
        if self.mode is Mode.IMAGE and self._imaging is not None:
            self._imaging.settle(view.grid, Pose2(x_m, y_m, self._wall_rad))
        else:
            self.frontiers.defer(x_m, y_m, why)
        self._look(Event.DEFERRED, view.pose.heading_rad, view.now_s, why=f"place={x_m:.2f},{y_m:.2f} {why}")

    def _look(
        self, event: Event, heading_rad: float, now_s: float, then_rad: float | None = None, why: str = ""
    ) -> None:
        """After an event that leads to LOOK."""
        self._happens(event, why)
        self._looking.begin(heading_rad, now_s, then_rad)

    def _stand_and_look(self, view: View) -> Motion:
        if self._looking.over(view.pose, view.now_s):
            self.pending.begin(self._choose(view))
        return Motion(Speed.STOP, self._looking.heading_rad)

    def _choose(self, view: View) -> Deliberation[None]:
        """The wall that was driven to, else the next goal."""
        if self._wall_due:
            self._happens(Event.WALL_REACHED)
            self._leg.begin(view.pose, self._wall_rad)
            return
        looked_rad = self._looking.heading_rad if self.mode is Mode.LOOK else None
        self._set_out(view, (yield from self._choice.next(view, looked_rad)))

    def _review_leg(self, view: View, opening: set[Cell]) -> Deliberation[None]:
        goal = yield from self._choice.on_leg(view, opening)
        if goal is not None:
            self._set_out(view, goal)

    def _set_out(self, view: View, goal: Goal) -> None:
        if goal.event in (Event.TURN, Event.LIST_UNSURE):
            self._look(goal.event, goal.heading_rad, self._now_s, why=goal.why)  # the view is as old as the choice
            return
        self._happens(goal.event, goal.why)
        if goal.event is Event.EXPLORED:
            self.log.leave_out(goal.blacklisted)
        if goal.event is Event.AHEAD:
            self._leg.begin(view.pose, goal.heading_rad)
        elif goal.path:
            self.path, self._target, self._wall_rad = goal.path, goal.path[-1], goal.heading_rad

    def _drive_leg(self, view: View) -> Motion:
        """Straight on along a hall or a wall, as long as that shows something new."""
        pose = view.pose
        self._hall.see(view.points, pose)
        if view.front_is_near or view.hall_bends or (self._leg.due(view) and not self._is_worth_going_on(view)):
            self._end_leg(view)
            return Motion(Speed.STOP, pose.heading_rad)
        return Motion(Speed.MEDIUM, self._hall.steered_rad(pose, view.left_m, view.right_m))

    def _is_worth_going_on(self, view: View) -> bool:
        """The leg; by the way, what it passes is noticed."""
        if self.mode is not Mode.STRAIGHT:
            return self._leg.shows_new_wall(view)
        to_review = self._leg.to_review(view)
        if to_review is not None and not self.pending.open:
            self._leg.reviewed(view.pose)
            self.pending.begin(self._review_leg(view, to_review))
        return self._leg.shows_new_floor(view)

    def _end_leg(self, view: View) -> None:
        self._choice.junction.end_leg(self._hall.start, view.pose)
        heading_rad = self._hall.along(view.pose.heading_rad)
        left = replace(view.pose, heading_rad=wrap_angle(heading_rad + pi / 2))
        if self._imaging is not None and self._imaging.shows_new(view.grid, left):
            # The wall ahead, of a dead end most often: it costs a turn now, and a whole path later
            self._imaging.settle(view.grid, left)
            self._look(Event.LEG_OVER, left.heading_rad, view.now_s, then_rad=heading_rad)
        else:
            self._look(Event.LEG_OVER, view.pose.heading_rad, view.now_s)

    def _follow_path(self, view: View) -> Motion:
        pose = view.pose
        stand = Motion(Speed.STOP, pose.heading_rad)
        if not self.path:
            mode = self.mode
            self.pending.begin(self._plan_path(view))
            if self.mode is not mode or not self.path:
                return stand
        if self.mode is Mode.ROUTE and not self.frontiers.something_near(*self._target):
            self._look(Event.GONE, pose.heading_rad, view.now_s)
            return stand
        if arrived(self.path, pose):
            self._arrive(view)
            return stand
        if not self.frontiers.is_clear(view, self.path):
            self.path = []
            return stand
        self.path = rest_of(self.path, pose)
        heading_rad = atan2(self.path[0][1] - pose.y_m, self.path[0][0] - pose.x_m)
        speed = speed_along(self.path, pose, heading_rad, view.grid)
        if speed is Speed.HIGH and self._imaging is not None:
            # Decision 1: slowly wherever the wall on the right was not seen yet
            speed = Speed.MEDIUM if self._imaging.worth_going_on(view.grid, pose, heading_rad) else speed
        return Motion(speed, heading_rad)

    def _plan_path(self, view: View) -> Deliberation[None]:
        """A path for the present mode, or another mode where there is none (now)."""
        if self.mode is Mode.ROUTE:
            if not (yield from self._finds_another_path(view)):
                yield from self._choose(view)
            return
        home = self.mode in GOING_HOME
        target = (0.0, 0.0) if home else self._target
        exact = home or view.grid.stands(*target)
        route = None
        if self.mode in GOING_TO_PLACE and not exact:
            route = yield from self.frontiers.route_before(view, target)
        if route is None:
            route = yield from self.frontiers.route(view, destination.cells_at(view.grid, target, exact))
        if route is not None:
            self._happens(Event.PATH)
            self.path = [*route[:-1], target] if exact else route
        elif self.mode is Mode.IMAGE:
            self._defer(view, "no path")
        elif self.mode is Mode.RETAKE:
            self._look(Event.NO_PATH, view.pose.heading_rad, view.now_s)
        else:
            kept_out = yield from self.frontiers.kept_out(view, destination.cells_at(view.grid, target, exact))
            self._wait_for_path(view, target)
            if kept_out:
                self._happens(Event.KEPT_OUT)

    def _finds_another_path(self, view: View) -> Deliberation[bool]:
        """To the entry of the list that it was on its way to, while that is one."""
        yield from self.frontiers.judged(view)
        if not self.frontiers.something_near(*self._target):
            return False
        route = yield from self.frontiers.route(view, destination.cells_at(view.grid, self._target, True))
        self.path = route or []
        return route is not None

    def _wait_for_path(self, view: View, target: tuple[float, float]) -> None:
        self._happens(Event.NO_PATH, f"place={target[0]:.2f},{target[1]:.2f}")
        waited_s = self._patience.wait_s(view.pose, view.now_s)
        if waited_s > hindrances.NO_PATH_PATIENCE_S:
            self._patience.renew()
            self._happens(Event.TOO_LONG, f"waited_s={waited_s:.0f} pose={view.pose.x_m:.2f},{view.pose.y_m:.2f}")
        elif waited_s > hindrances.OBSTACLES_PATIENCE_S and self.frontiers.forget_obstacles():
            self.log.note("no path: obstacles that were met are forgotten, what it drove over is tried again")

    def _arrive(self, view: View) -> None:
        self.path = []
        self._obstacles.arrive()
        mode, now_s = self.mode, view.now_s
        if mode is Mode.RETAKE:
            self._look(Event.ARRIVED, self._retake_rad, now_s)
        elif mode is Mode.IMAGE:
            self._look(Event.ARRIVED, self._wall_rad, now_s)
            self._wall_due = True
        elif mode is Mode.ROUTE:
            pose, (x_m, y_m) = view.pose, self._target
            direction = frontiers.unknown_direction_rad(view.grid, pose.x_m, pose.y_m, pose.heading_rad)
            self.frontiers.mark_visited(x_m, y_m)
            self._look(Event.ARRIVED, self._hall.along(direction), now_s, why=f"visited={x_m:.2f},{y_m:.2f}")
        else:
            self._align_until_s = now_s + TURN_TIMEOUT_S
            self._happens(Event.ARRIVED)
