"""The mission as a state machine, driven over drawn floors by a robot without inertia."""

from __future__ import annotations

from math import cos, inf, nan, pi, radians, sin

import numpy as np
import pytest

from common.geometry import Pose2, wrap_angle
from common.messages.mapping import MapUpdate
from common.messages.mission import Outcome
from common.messages.motion import Speed
from common.wall_points import WallPointMap
from onboard.planner.exploration.queries import JudgedGrid
from onboard.planner.exploration.recovery_memory import BLOCK_FOR_S
from onboard.planner.exploration.wall_imaging import WallImaging
from onboard.planner.grid.deliberation import Grids, Query
from onboard.planner.grid.grid_map import GridMap
from onboard.planner.grid.view import Motion, View
from onboard.planner.mission.hindrances import NO_PATH_PATIENCE_S, OBSTACLES_PATIENCE_S
from onboard.planner.mission.mission import Mission
from onboard.planner.mission.table import Event, Mode
from tests.unit.test_planner_grid_map import Box, drawn, hall
from tests.unit.test_planner_route_planning import two_rooms

PERIOD_S = 0.1
SPEEDS = {Speed.REVERSE: -0.16, Speed.STOP: 0.0, Speed.MEDIUM: 0.16, Speed.HIGH: 0.3}
TURN_RAD_S = 0.8
WALLS: list[Box] = [(-2.0, -1.1, 6.0, -1.0), (-2.0, 1.0, 6.0, 1.1), (-2.1, -1.1, -2.0, 1.1), (6.0, -1.1, 6.1, 1.1)]


def closed_hall() -> GridMap:
    """A hall along x through the origin of the map, all of it known."""
    return drawn([(-2.0, -1.0, 6.0, 1.0)], WALLS, (12.0, 6.0), (-4.0, -3.0))


class Drive:
    """Mission and robot on one unchanging grid."""

    def __init__(self, grid: GridMap, pose: Pose2) -> None:
        self.grid, self.pose = grid, pose
        self.mission = Mission()
        self.now_s = 100.0
        self.revision = 0
        self.walls = WallPointMap()
        self.answers_every = 1  # steps
        self._query: Query | None = None
        self._grids = Grids()
        self._steps = 0

    def view(self) -> View:
        return View(self.now_s, self.pose, self.grid, self.revision, self.walls, nan, nan, nan)

    def step(self) -> Motion:
        self.now_s += PERIOD_S
        if int(self.now_s) != self.revision and not self.mission.pending.open:
            self._new_grid(int(self.now_s))
        self._steps += 1
        if self._query is not None and self._steps % self.answers_every == 0:
            query, self._query = self._query, None
            self.mission.pending.receive(query, query.answer(self._grids))
        motion = self.mission.step(self.view())
        self._query = self.mission.pending.take() or self._query
        off_rad = wrap_angle(motion.heading_rad - self.pose.heading_rad)
        turn_rad = max(-TURN_RAD_S * PERIOD_S, min(TURN_RAD_S * PERIOD_S, off_rad))
        step_m = 0.0 if abs(off_rad) > radians(15.0) else SPEEDS[motion.speed] * PERIOD_S
        heading_rad = wrap_angle(self.pose.heading_rad + turn_rad)
        self.pose = Pose2(
            self.pose.x_m + step_m * cos(heading_rad), self.pose.y_m + step_m * sin(heading_rad), heading_rad
        )
        return motion

    def _new_grid(self, revision: int) -> None:
        self.revision = revision
        self._grids.put(revision, self.grid)
        judged = self.mission.frontiers.query(revision, self.pose).answer(self._grids)
        assert isinstance(judged, JudgedGrid)
        self.mission.frontiers.take_in(judged)

    def until(self, mode: Mode, within_s: float) -> bool:
        end_s = self.now_s + within_s
        while self.mission.mode is not mode and self.now_s < end_s:
            self.step()
        return self.mission.mode is mode

    def nearest_wall_m(self) -> float:
        return float(self.grid.clearance_m(self.grid.cell(self.pose.x_m, self.pose.y_m)))


def test_a_mission_waits_for_its_start() -> None:
    drive = Drive(closed_hall(), Pose2(0.0, 0.0, 0.0))
    assert {drive.step().speed for _ in range(30)} == {Speed.STOP}
    assert drive.mission.mode is Mode.WAITING


@pytest.mark.requirement("PLN_MR_01")
def test_a_floor_that_is_all_known_is_done_and_the_robot_comes_home() -> None:
    drive = Drive(closed_hall(), Pose2(4.0, 0.3, 2.0))
    drive.mission.start(drive.pose, drive.now_s)
    assert drive.until(Mode.DONE, 180.0)
    assert drive.pose.distance_m(Pose2(0.0, 0.0, 0.0)) < 0.2
    assert abs(drive.pose.heading_rad) < radians(5.0)
    assert drive.mission.state.outcome is Outcome.FINISHED
    assert drive.step().speed is Speed.STOP


@pytest.mark.requirement("PLN_MR_01")
def test_what_cannot_be_reached_is_given_up_by_place_and_reason() -> None:
    """Something that no map shows stands in front of the unseen end of a hall, and stays."""
    drive = Drive(drawn([(-2.0, -1.0, 6.0, 1.0)], WALLS[:3], (14.0, 6.0), (-4.0, -3.0)), Pose2(2.0, 0.0, pi))
    drive.mission.start(drive.pose, drive.now_s)
    while drive.mission.mode is not Mode.DONE:
        drive.step()
        if (
            drive.pose.x_m > 5.0
            and abs(drive.pose.heading_rad) < 1.0
            and drive.mission.mode in (Mode.STRAIGHT, Mode.ROUTE)
        ):
            drive.mission.blocked(drive.view(), 0.0)
        assert drive.now_s < 1000.0
    assert drive.mission.state.outcome is Outcome.FINISHED
    (place,) = drive.mission.log.blacklisted
    assert place.startswith("6.0,")
    assert place.endswith("in the way")
    assert drive.mission.log.text == "finished, and home, 1 place left out"
    assert any(note == f"given up {place}" for note in drive.mission.log.take())
    drive.mission.start(drive.pose, drive.now_s)
    assert drive.mission.log.blacklisted == ()


def test_a_place_that_was_asked_for_is_driven_to_round_the_wall() -> None:
    drive = Drive(two_rooms(1.6), Pose2(2.0, 1.6, 0.0))
    drive.mission.order(Event.GO_TO, (8.0, 1.6))
    nearest_m = inf
    while drive.mission.mode is not Mode.DONE and drive.now_s < 250.0:
        drive.step()
        nearest_m = min(nearest_m, drive.nearest_wall_m())
    assert drive.pose.distance_m(Pose2(8.0, 1.6, 0.0)) < 0.8
    assert nearest_m > 0.25
    assert drive.mission.state.outcome is Outcome.ARRIVED


def test_a_place_without_a_path_is_given_up_after_a_while_and_the_next_order_is_taken() -> None:
    drive = Drive(closed_hall(), Pose2(4.0, 0.0, 0.0))
    drive.mission.order(Event.GO_TO, (4.0, 20.0))
    assert drive.until(Mode.GOTO_BLOCKED, 20.0)
    assert not drive.until(Mode.DONE, NO_PATH_PATIENCE_S - 10.0)
    assert drive.until(Mode.DONE, 20.0)
    assert drive.mission.state.outcome is Outcome.GAVE_UP
    drive.mission.order(Event.GO_HOME)
    assert drive.until(Mode.DONE, 180.0)
    assert drive.mission.state.outcome is Outcome.HOME


def test_a_place_without_a_path_does_not_flip_between_two_modes() -> None:
    drive = Drive(closed_hall(), Pose2(4.0, 0.0, 0.0))
    drive.mission.order(Event.GO_TO, (4.0, 20.0))
    assert drive.until(Mode.GOTO_BLOCKED, 20.0)
    modes = set()
    for _ in range(200):
        drive.step()
        modes.add(drive.mission.mode)
    assert modes == {Mode.GOTO_BLOCKED}
    assert sum("GOTO_BLOCKED" in note for note in drive.mission.log.take()) == 1


def test_a_way_that_is_free_again_is_driven() -> None:
    drive = Drive(two_rooms(0.0), Pose2(2.0, 1.6, 0.0))
    drive.mission.order(Event.GO_TO, (8.0, 1.6))
    assert drive.until(Mode.GOTO_BLOCKED, 20.0)
    drive.grid = two_rooms(1.6)
    assert drive.until(Mode.GOTO, 10.0)
    assert drive.until(Mode.DONE, 250.0)
    assert drive.mission.state.outcome is Outcome.ARRIVED


def test_choices_and_changes_of_mode_are_noted_once_with_their_figures() -> None:
    drive = Drive(closed_hall(), Pose2(4.0, 0.3, 2.0))
    drive.mission.start(drive.pose, drive.now_s)
    assert drive.until(Mode.DONE, 180.0)
    notes = drive.mission.log.take()
    assert drive.mission.log.take() == []
    assert notes[0] == "mode=LOOK outcome=NONE paused=False before=WAITING event=START"
    assert notes[-1] == "mode=DONE outcome=FINISHED paused=False before=ALIGN event=ALIGNED"
    assert any("event=EXPLORED taken=NONE RIGHT=" in note for note in notes)
    assert len(notes) < 20


def test_a_way_that_takes_long_to_find_is_waited_for_and_driven() -> None:
    drive = Drive(drawn([(0.0, 0.0, 9.0, 5.0)]), Pose2(8.0, 4.0, 0.0))
    drive.answers_every = 30
    drive.mission.order(Event.GO_TO, (2.0, 2.0))
    speeds = [drive.step().speed]
    while drive.mission.pending.open:
        speeds.append(drive.step().speed)
    assert speeds[:-1] == [Speed.STOP] * (len(speeds) - 1)
    assert 20 < len(speeds) < 50
    assert drive.mission.path[-1] == (2.0, 2.0)
    assert drive.step().speed is not Speed.STOP


def test_who_is_sent_home_does_not_go_on_looking_for_another_way() -> None:
    drive = Drive(drawn([(-1.0, -1.0, 9.0, 5.0)], [], (10.0, 6.0), (-1.0, -1.0)), Pose2(8.0, 4.0, 0.0))
    drive.answers_every = 30
    drive.mission.order(Event.GO_TO, (2.0, 4.0))
    drive.step()
    assert drive.mission.pending.open
    drive.mission.order(Event.GO_HOME)
    while drive.step().speed is Speed.STOP:
        assert drive.now_s < 130.0
    assert drive.mission.path[-1] == (0.0, 0.0)


def test_a_leg_goes_on_while_it_is_found_out_whether_an_opening_can_be_entered() -> None:
    side = [(1.0, 2.0, 9.0, 4.0), (3.0, 1.5, 5.0, 2.0)]
    walls = [(1.0, 4.0, 9.0, 4.1), (1.0, 1.9, 3.0, 2.0), (5.0, 1.9, 9.0, 2.0), (0.9, 1.9, 1.0, 4.1)]
    drive = Drive(drawn(side, walls), Pose2(2.0, 3.0, 0.0))
    drive.mission.start(drive.pose, drive.now_s)
    assert drive.until(Mode.STRAIGHT, 20.0)
    drive.answers_every = 7
    speeds = set()
    while drive.mission.mode is Mode.STRAIGHT:
        deliberated, speed = drive.mission.pending.open, drive.step().speed
        if deliberated and drive.mission.mode is Mode.STRAIGHT:
            speeds.add(speed)
        assert drive.now_s < 160.0
    assert drive.mission.mode is Mode.ROUTE
    assert speeds == {Speed.MEDIUM}
    assert drive.mission.path[-1][1] < 2.0


def test_a_step_without_its_answer_begins_the_choice_anew() -> None:
    drive = Drive(closed_hall(), Pose2(4.0, 0.3, 2.0))
    drive.answers_every = 10_000
    drive.mission.order(Event.GO_HOME)
    drive.step()
    assert drive.mission.pending.open
    drive.mission.pending.abandon()
    drive.answers_every = 1
    assert drive.until(Mode.DONE, 180.0)


def test_home_that_cannot_be_reached_is_waited_for_and_reached_when_the_way_is_open_again() -> None:
    drive = Drive(closed_hall(), Pose2(4.0, 0.0, 0.0))
    open_floor = drive.grid
    drive.grid = drawn(
        [(-2.0, -1.0, 6.0, 1.0)],
        [
            (2.0, -1.0, 2.1, 1.0),
            (-2.0, -1.1, 6.0, -1.0),
            (-2.0, 1.0, 6.0, 1.1),
            (-2.1, -1.1, -2.0, 1.1),
            (6, -1, 6.1, 1),
        ],
        (12.0, 6.0),
        (-4.0, -3.0),
    )
    drive.mission.order(Event.GO_HOME)
    assert drive.until(Mode.HOME_BLOCKED, 20.0)
    for _ in range(100):
        drive.step()
    assert drive.pose.x_m > 2.3
    drive.grid = open_floor
    assert drive.until(Mode.DONE, 180.0)


def test_something_that_blocks_a_wide_hall_is_driven_round() -> None:
    drive = Drive(drawn([(0.0, 0.0, 10.0, 6.0)]), Pose2(2.0, 3.0, 0.0))
    drive.mission.order(Event.GO_TO, (8.0, 3.0))
    drive.step()
    drive.mission.blocked(drive.view(), 0.0)
    assert {drive.step().speed for _ in range(20)} != {Speed.STOP}


def test_the_list_is_not_empty_for_sure_while_something_stands_in_the_way() -> None:
    drive = Drive(closed_hall(), Pose2(4.0, 0.0, 0.0))
    drive.mission.start(drive.pose, drive.now_s)
    drive.mission.blocked(drive.view(), 0.0)
    assert not drive.until(Mode.HOME, BLOCK_FOR_S - 2 * PERIOD_S)
    assert drive.until(Mode.HOME, 20.0)


def test_a_long_pause_does_not_cost_the_entry_of_the_list_that_was_under_way() -> None:
    drive = Drive(
        drawn([(0.0, 0.0, 2.0, 6.0), (2.0, 4.0, 8.0, 6.0)], [(2.0, 0.0, 2.1, 4.0), (2.0, 3.9, 8.0, 4.0)]),
        Pose2(1.0, 1.0, pi),
    )
    drive.mission.start(drive.pose, drive.now_s)
    assert drive.until(Mode.ROUTE, 60.0)
    for _ in range(40):
        drive.step()
    assert drive.mission.mode is Mode.ROUTE
    for _ in range(4):
        drive.now_s += 60.0
        drive.step()
    assert drive.mission.mode is Mode.ROUTE


def test_a_lost_path_to_an_entry_of_the_list_is_found_anew_and_no_other_entry_chosen() -> None:
    side = [(1.0, 2.0, 9.0, 4.0), (3.0, 1.5, 5.0, 2.0)]
    walls = [(1.0, 4.0, 9.0, 4.1), (1.0, 1.9, 3.0, 2.0), (5.0, 1.9, 9.0, 2.0), (0.9, 1.9, 1.0, 4.1)]
    drive = Drive(drawn(side, walls), Pose2(2.0, 3.0, 0.0))
    drive.mission.start(drive.pose, drive.now_s)
    assert drive.until(Mode.ROUTE, 60.0)
    where = drive.mission.path[-1]
    choices = len(drive.mission.log.take())
    drive.mission.path = []
    while not drive.mission.path:
        drive.step()
    assert drive.mission.mode is Mode.ROUTE
    assert np.hypot(*np.subtract(drive.mission.path[-1], where)) < 0.5
    assert choices
    assert drive.mission.log.take() == []


def test_the_first_look_takes_its_time_whatever_the_clock_says() -> None:
    drive = Drive(hall(closed=False), Pose2(4.0, 2.0, 0.0))
    drive.mission.start(drive.pose, drive.now_s)
    assert {drive.step().speed for _ in range(10)} == {Speed.STOP}


def test_a_place_that_cannot_be_reached_is_not_answered_with_another() -> None:
    drive = Drive(closed_hall(), Pose2(4.0, 0.0, 0.0))
    drive.mission.order(Event.GO_TO, (4.0, 20.0))
    for _ in range(600):
        drive.step()
    assert drive.pose.distance_m(Pose2(4.0, 0.0, 0.0)) < 0.3


@pytest.mark.requirement("PLN_MR_01")
def test_a_way_that_was_chosen_at_a_junction_is_driven_before_another_is_chosen() -> None:
    """Open floor on all sides: who chose the right-most branch at every stop would turn round and round on the spot."""
    drive = Drive(drawn([(-2.0, -2.0, 2.0, 2.0)], [], (12.0, 12.0), (-6.0, -6.0)), Pose2(0.0, 0.0, 0.0))
    drive.mission.start(drive.pose, drive.now_s)
    turned_rad, turned_by_leg = 0.0, []
    for _ in range(600):
        mode, heading_rad = drive.mission.mode, drive.pose.heading_rad
        drive.step()
        turned_rad += abs(wrap_angle(drive.pose.heading_rad - heading_rad))
        moving = (Mode.STRAIGHT, Mode.ROUTE)
        if drive.mission.mode in moving and mode not in moving:
            turned_by_leg.append(turned_rad)
            turned_rad = 0.0
    assert len(turned_by_leg) >= 2
    assert max(turned_by_leg) < radians(200.0)


def test_detour_that_nobody_wants_any_more_ends() -> None:
    mission = Mission()
    mission.start(Pose2(0.0, 0.0, 0.0), 0.0)
    mission.detour(Pose2(2.0, 0.0, 0.0))
    assert mission.mode is Mode.RETAKE
    mission.end_detour(0.0, 1.0)
    assert mission.mode is Mode.LOOK
    mission.order(Event.GO_HOME)
    mission.end_detour(0.0, 2.0)
    assert mission.mode is Mode.HOME


def test_a_robot_with_a_camera_has_every_wall_on_its_right_before_it_goes_home() -> None:
    drive, eye = Drive(closed_hall(), Pose2(0.0, 0.0, 0.0)), WallImaging()
    drive.mission = Mission(images_walls=True)
    drive.mission.start(drive.pose, drive.now_s)
    walls = np.count_nonzero(eye.unseen(drive.grid))
    modes = set()
    while drive.mission.mode is not Mode.HOME:
        drive.step()
        eye.look(drive.grid, drive.pose)
        modes.add(drive.mission.mode)
        assert drive.now_s < 600.0
    assert Mode.ALONG_WALL in modes
    assert np.count_nonzero(eye.unseen(drive.grid)) < 0.1 * walls


def test_another_photo_is_taken_from_where_it_was_asked_for() -> None:
    drive = Drive(closed_hall(), Pose2(0.0, 0.0, 0.0))
    drive.mission.start(drive.pose, drive.now_s)
    drive.step()
    drive.mission.detour(Pose2(3.0, 0.3, pi))
    assert drive.mission.mode is Mode.RETAKE
    assert drive.until(Mode.LOOK, 60.0)
    assert drive.pose.distance_m(Pose2(3.0, 0.3, 0.0)) < 0.2


def test_a_robot_that_stands_askew_in_a_hall_turns_along_it_before_it_goes_on() -> None:
    drive = Drive(hall(8.0, 2.0, closed=False), Pose2(4.0, 2.0, 0.0))
    points = np.stack([np.arange(1.0, 9.0, 0.05), np.full(160, 1.0)], axis=1).astype(np.float32)
    drive.walls.apply(MapUpdate(0.0, 1, 0, points, np.zeros(160, np.uint8)))
    drive.mission.start(drive.pose, drive.now_s)
    assert drive.until(Mode.STRAIGHT, 20.0)
    while drive.pose.x_m < 6.0:
        drive.step()
    drive.pose = Pose2(drive.pose.x_m, drive.pose.y_m, radians(-40.0))
    drive.mission.blocked(drive.view(), radians(-60.0))
    while drive.step().speed is Speed.STOP:
        pass
    assert abs(drive.pose.heading_rad) < radians(5.0)


def test_a_wall_that_cannot_be_reached_is_given_up_and_not_tried_for_ever() -> None:
    """Something that no map shows stands beside the path, next to every place where it wants to stand."""
    drive = Drive(closed_hall(), Pose2(0.0, 0.0, 0.0))
    drive.mission = Mission(images_walls=True)
    drive.mission.start(drive.pose, drive.now_s)
    began_s = drive.now_s
    while drive.mission.mode is not Mode.HOME:
        drive.step()
        path = drive.mission.path
        if drive.mission.mode is Mode.IMAGE and path and drive.pose.distance_m(Pose2(*path[-1], 0.0)) < 0.5:
            drive.mission.blocked(drive.view(), radians(-80.0))
            drive.pose = drive.pose.compose(Pose2(-0.2, 0.0, 0.0))
        assert drive.now_s - began_s < 600.0


def walled_off() -> GridMap:
    """The same hall with a wall across it between the robot and home."""
    return drawn([(-2.0, -1.0, 6.0, 1.0)], [(2.0, -1.0, 2.1, 1.0), *WALLS], (12.0, 6.0), (-4.0, -3.0))


def test_who_finds_no_way_home_asks_for_help_after_a_while() -> None:
    drive = Drive(walled_off(), Pose2(4.0, 0.0, 0.0))
    drive.mission.order(Event.GO_HOME)
    assert drive.until(Mode.HOME_BLOCKED, 20.0)
    assert not drive.until(Mode.DONE, NO_PATH_PATIENCE_S - 10.0)
    assert drive.until(Mode.DONE, 20.0)
    assert drive.mission.state.outcome is Outcome.NEEDS_HELP
    assert drive.mission.log.text == "needs help: no way home"


def test_obstacles_that_leave_no_way_home_are_tried_again_after_a_while() -> None:
    """A narrow hall, and an echo from a corner in it that was taken for an obstacle for long."""
    walls: list[Box] = [(-2.0, -0.6, 6.0, -0.5), (-2.0, 0.5, 6.0, 0.6), (-2.1, -0.6, -2.0, 0.6), (6.0, -0.6, 6.1, 0.6)]
    drive = Drive(drawn([(-2.0, -0.5, 6.0, 0.5)], walls, (12.0, 6.0), (-4.0, -3.0)), Pose2(4.0, 0.0, pi))
    for _ in range(4):
        drive.mission.blocked(drive.view(), 0.0)  # each time for twice as long
    drive.mission.order(Event.GO_HOME)
    assert drive.until(Mode.HOME_BLOCKED, 20.0)
    assert drive.until(Mode.DONE, OBSTACLES_PATIENCE_S + 90.0)
    assert drive.mission.state.outcome is Outcome.HOME


def test_who_meets_something_again_and_again_on_the_way_home_asks_for_help() -> None:
    """The grid shows a path, but a sonar stops every step along it."""
    drive = Drive(closed_hall(), Pose2(4.0, 0.0, pi))
    drive.mission.order(Event.GO_HOME)
    began_s = drive.now_s
    while drive.mission.mode is not Mode.DONE:
        pose = drive.pose
        if drive.step().speed is not Speed.STOP:
            drive.pose = pose
            drive.mission.blocked(drive.view(), 0.0)
        assert drive.now_s - began_s < 2 * NO_PATH_PATIENCE_S
    assert drive.mission.state.outcome is Outcome.NEEDS_HELP
