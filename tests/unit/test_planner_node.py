"""The Planner as a node: what it drives on, what makes it stand, and what never sets it in motion."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from math import inf, nan, pi, radians
from typing import Any

import numpy as np
import pytest

from common.bus import ALIVE_PERIODS, LocalMesh
from common.constants import SONAR_COUNT
from common.errors import ErrorCode
from common.geometry import wrap_angle
from common.messages.mapping import GridUpdate, MapUpdate, PoseEstimate
from common.messages.mission import Operation, OperatorCommand, Outcome
from common.messages.motion import CarrierReport, CarrierState, Distances, DriveCommand, Odometry, Ranges, Speed
from common.messages.stop import Permit
from common.messages.topics import (
    CARRIER,
    DISTANCES,
    DRIVE,
    GRID,
    MAP,
    ODOMETRY,
    OPERATION,
    PERMIT,
    PLAN,
    POSE,
    RANGES,
    STATUS,
    Topic,
)
from common.node import STEP_GAP_S, Agenda
from common.pace import LATE_S
from common.side_work import LOOK_S, DeferredWorker, JobOutcome, WorkLost
from onboard.planner.driving.drive_commands import COMMAND_MAX_S
from onboard.planner.driving.net_rotation_balancing import AHEAD_RAD
from onboard.planner.driving.zero_velocity_update import REST_EVERY_S, REST_S
from onboard.planner.grid.deliberation import Deliberator, Query, deferred_deliberator, load
from onboard.planner.planner import Planner
from onboard.planner.zones.zone_keeper import ZoneKeeper
from tests.unit.test_planner_grid_map import drawn, hall, update_of

TICK_S = 0.005
FAR = (1.0, nan, nan, nan, 1.0)
SOMETHING_AHEAD = (1.0, nan, 0.25, nan, 1.0)


class Robot:
    """The Planner with everything around it in good order, and nothing that moves: the pose is the test's to set."""

    def __init__(self, deliberator: Deliberator | None = None, zones: ZoneKeeper | None = None) -> None:
        self.mesh = LocalMesh()
        self.planner = Planner(deliberator or deferred_deliberator(), zones=zones)
        self.bus = self.mesh.endpoint("planner")
        self.bus.wake_on(self.planner.wakes_on)
        self.steps_s: list[float] = []
        self._agenda = Agenda(self.planner, 0.0)
        self.others = self.mesh.endpoint("others")
        self.others.take(DRIVE)
        self.pose: PoseEstimate | None = PoseEstimate(0.0, 2.0, 2.0, 0.0, 0.3, 0.05, 0.01, 0)
        self.ranges_m: tuple[float, ...] | None = FAR
        self.permit: Permit | None = Permit(0.0, True, "", stop_epoch=1)
        self.grid: GridUpdate | None = update_of(hall(length_m=6.0, closed=False))
        self._ticks = 0

    @property
    def now_s(self) -> float:
        return self.mesh.now_s

    def run(self, seconds: float) -> list[DriveCommand]:
        """Every sender at its rate; the commands that were given meanwhile."""
        for _ in range(round(seconds / TICK_S)):
            self._ticks += 1
            self.mesh.now_s = self._ticks * TICK_S
            if self._ticks % 20 == 1:
                self._report()
            self._step_when_due()
        return self.others.take(DRIVE)

    def run_until(self, what: Callable[[DriveCommand], bool], within_s: float) -> float:
        """How long it took until such a command was published (s)."""
        began_s = self.now_s
        while self.now_s < began_s + within_s:
            found = [command.t_s for command in self.run(TICK_S) if what(command)]
            if found:
                return found[0] - began_s
        raise AssertionError(f"no such command within {within_s} s")

    def _step_when_due(self) -> None:
        due = self.now_s >= self._agenda.due_s - 1e-9 or self.bus.woken
        if due and self.now_s >= self._agenda.earliest_s - 1e-9:
            self.bus.woken = False
            self.steps_s.append(self.now_s)
            self._agenda.stepped(self.now_s, self.planner.step(self.bus, self.now_s))

    def _report(self) -> None:
        say, now_s = self.others.publish, self.now_s
        if self.pose is not None:
            say(POSE, replace(self.pose, t_s=now_s))
        if self.ranges_m is not None:
            say(RANGES, Ranges(now_s, self.ranges_m, (0.0,) * SONAR_COUNT))
            say(DISTANCES, Distances(now_s, self.ranges_m[0], self.ranges_m[4], self.ranges_m[2]))
        if self.permit is not None:
            say(PERMIT, replace(self.permit, t_s=now_s))
        if self.grid is not None and self._ticks % 200 == 1:
            self.grid = replace(self.grid, t_s=now_s, revision=self.grid.revision + 1)
            say(GRID, self.grid)
        driven = self.others.latest(DRIVE)
        standing = driven is None or driven.speed is Speed.STOP
        say(ODOMETRY, Odometry(now_s, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, standing, False, False, session=1))
        say(CARRIER, CarrierReport(now_s, CarrierState.READY, 0, 0, 0, 0.0, 0, 0, True, False, 12.0))

    def ask(
        self, operation: Operation, x_m: float = 0.0, y_m: float = 0.0, epoch: int = 1, command_id: int = 0
    ) -> None:
        self.order(OperatorCommand(self.now_s, operation, x_m, y_m, command_id=command_id, epoch=epoch))

    def order(self, command: OperatorCommand) -> None:
        self.others.publish(OPERATION, command)

    def turn_to(self, heading_rad: float) -> None:
        assert self.pose is not None
        self.pose = replace(self.pose, heading_rad=heading_rad, yaw_rad=wrap_angle(heading_rad + 0.3))

    def error(self) -> int:
        status = self.others.latest(STATUS["planner"])
        assert status is not None
        return status.error_code

    def started(self) -> Robot:
        """Exploring along the hall."""
        self.run(0.5)
        self.ask(Operation.START)
        commands = self.run(4.0)
        assert moving(commands[-5:])
        return self


def moving(commands: list[DriveCommand]) -> bool:
    return any(command.speed is not Speed.STOP for command in commands)


@pytest.mark.requirement("PLN_MR_02")
def test_robot_stands_until_it_is_started_and_then_follows_the_hall() -> None:
    robot = Robot()
    assert not moving(robot.run(3.0))
    robot.ask(Operation.START)
    commands = robot.run(4.0)
    assert commands[-1].speed is Speed.MEDIUM
    assert commands[-1].yaw_rad == pytest.approx(0.3, abs=0.3), "heading 0 of the map is yaw 0.3 of the board"


@pytest.mark.requirement("PLN_MR_02")
def test_commands_come_at_least_ten_times_a_second_and_ids_never_fall() -> None:
    robot = Robot().started()
    commands = robot.run(3.0)
    assert np.diff([c.t_s for c in commands]).max() < 0.1 + LATE_S + STEP_GAP_S
    assert (np.diff([c.command_id for c in commands]) >= 0).all()


def test_standing_commands_keep_their_id_so_that_the_carrier_is_left_in_peace() -> None:
    assert len({c.command_id for c in Robot().run(3.0)}) == 1


def test_a_command_in_motion_keeps_its_id_while_its_heading_does_and_for_a_second_at_most() -> None:
    """Whoever dropped it, at a stop that the planner has not seen, begins the next one."""
    robot = Robot().started()
    robot.run(3.0)
    newest: dict[int, list[float]] = {}
    for command in robot.run(4.0):
        newest.setdefault(command.command_id, []).append(command.t_s)
    assert 4 <= len(newest) <= 12, "straight on, ten times a second"
    assert all(times_s[-1] - times_s[0] <= COMMAND_MAX_S for times_s in newest.values())


def lose(robot: Robot, what: str) -> None:
    assert robot.pose is not None
    if what == "permit":
        robot.permit = Permit(0.0, False, "a module is missing")
    elif what == "pose":
        robot.pose = None
    elif what == "valid pose":
        robot.pose = replace(robot.pose, valid=False)
    else:
        robot.ranges_m = None


@pytest.mark.requirement("CM_MR_02")
@pytest.mark.parametrize(
    ("what", "error"),
    [
        ("permit", ErrorCode.NO_PERMIT),
        ("pose", ErrorCode.NO_POSE),
        ("valid pose", ErrorCode.NO_POSE),
        ("ranges", ErrorCode.NO_RANGES),
    ],
)
def test_robot_stands_when_something_it_rests_on_is_missing_and_goes_on_when_it_is_back(
    what: str, error: ErrorCode
) -> None:
    robot, good = Robot().started(), Robot()
    lose(robot, what)
    commands = robot.run(1.5)
    assert commands[-1].speed is Speed.STOP
    assert not moving([c for c in commands if c.t_s > commands[0].t_s + 0.4])
    assert robot.error() == error
    robot.pose, robot.ranges_m, robot.permit = good.pose, good.ranges_m, good.permit
    assert moving(robot.run(3.0)[-5:])


@pytest.mark.parametrize("what", ["permit", "pose", "valid pose", "ranges"])
def test_before_the_start_nothing_that_comes_or_goes_moves_the_robot(what: str) -> None:
    robot = Robot()
    kept = (robot.pose, robot.ranges_m, robot.permit, robot.grid)
    robot.pose = robot.ranges_m = robot.permit = robot.grid = None
    assert not moving(robot.run(1.0))
    robot.pose, robot.ranges_m, robot.permit, robot.grid = kept
    assert not moving(robot.run(1.0))


def test_a_command_is_taken_once_however_often_it_comes_and_acknowledged() -> None:
    robot = Robot()
    robot.run(0.5)
    robot.others.take(PLAN)
    robot.run(0.2)
    assert all(view.command_id == 0 for view in robot.others.take(PLAN))
    asked_s = robot.now_s
    start = OperatorCommand(asked_s, Operation.START, command_id=7)
    robot.others.publish(OPERATION, start)
    robot.run(0.1)
    answer = robot.others.take(PLAN)[0]
    assert (answer.command_id, answer.mode) == (7, "LOOK")
    assert answer.t_s - asked_s < 0.05, "at once, not with the next view"
    robot.others.publish(OPERATION, OperatorCommand(robot.now_s, Operation.PAUSE, command_id=8))
    robot.run(0.1)
    robot.others.publish(OPERATION, start)
    assert not moving(robot.run(4.0)), "a late repeat of the start must not end the pause"
    assert robot.others.take(PLAN)[-1].command_id == 8


def test_a_start_without_a_pose_is_not_taken_until_there_is_one() -> None:
    robot, good = Robot(), Robot()
    robot.pose = None
    robot.others.publish(OPERATION, OperatorCommand(0.0, Operation.START, command_id=7))
    robot.run(1.0)
    assert robot.others.take(PLAN)[-1].command_id == 0
    robot.pose = good.pose
    robot.run(0.2)
    robot.others.publish(OPERATION, OperatorCommand(0.0, Operation.START, command_id=7))
    robot.run(1.0)
    assert robot.others.take(PLAN)[-1].command_id == 7


@pytest.mark.requirement("CC_MR_04")
def test_a_resume_is_taken_only_for_the_newest_stop_and_once_that_is_released() -> None:
    robot = Robot().started()
    robot.permit = Permit(0.0, False, "stopped by operator", ("operator",), stop_epoch=3, resumed=False)
    assert not moving(robot.run(2.0)[20:])

    def taken(command_id: int, epoch: int) -> bool:
        resume = OperatorCommand(robot.now_s, Operation.RESUME, command_id=command_id, epoch=epoch)
        robot.others.publish(OPERATION, resume)
        robot.run(0.1)
        return any(view.command_id == command_id for view in robot.others.take(PLAN))

    robot.others.take(PLAN)
    robot.run(0.6)
    assert not taken(7, 3), "it is latched"
    robot.permit = Permit(0.0, False, "released, waiting for a resume", stop_epoch=3, resumed=False)
    robot.run(0.6)
    assert not taken(8, 2), "another stop is meant"
    assert taken(9, 3)
    assert not moving(robot.run(1.0)), "comm has not granted it"
    robot.permit = Permit(0.0, True, "", stop_epoch=3)
    assert moving(robot.run(3.0)[-5:])


def test_a_paused_robot_in_front_of_something_does_not_back_off() -> None:
    robot = Robot().started()
    robot.ranges_m = SOMETHING_AHEAD
    robot.run(0.5)
    robot.ask(Operation.PAUSE)
    assert not moving(robot.run(4.0))


@pytest.mark.requirement("CM_MR_02")
@pytest.mark.parametrize("what", ["permit", "valid pose", "ranges"])
def test_a_robot_in_trouble_is_not_asked_to_turn(what: str) -> None:
    robot = Robot().started()
    robot.turn_to(pi / 2)
    robot.run(0.3)
    lose(robot, what)
    asked = robot.run(1.0)[-1]
    assert asked.speed is Speed.STOP
    assert robot.pose is not None
    assert wrap_angle(asked.yaw_rad - robot.pose.yaw_rad) == pytest.approx(0.0, abs=0.1)


def test_pause_stands_and_resume_goes_on() -> None:
    robot = Robot().started()
    robot.ask(Operation.PAUSE)
    assert not moving(robot.run(2.0)[1:])
    status = robot.others.latest(STATUS["planner"])
    assert status is not None
    assert status.state == "PAUSED"
    robot.ask(Operation.RESUME)
    assert moving(robot.run(3.0)[-5:])


def test_a_resume_after_a_stop_leaves_an_earlier_pause_and_the_next_one_ends_it() -> None:
    robot = Robot().started()
    robot.ask(Operation.PAUSE)
    robot.run(0.5)
    stopped = Permit(0.0, False, "stopped by operator", ("operator",), stop_epoch=2, resumed=False)
    robot.permit = stopped
    robot.run(0.5)
    robot.permit = replace(stopped, stop_sources=())
    robot.run(0.5)
    view = robot.others.latest(PLAN)
    assert view is not None
    assert view.outcome is Outcome.STOPPED
    robot.ask(Operation.RESUME, epoch=2, command_id=5)
    robot.permit = Permit(0.0, True, "", stop_epoch=2)
    assert not moving(robot.run(3.0)[1:])
    view = robot.others.latest(PLAN)
    assert view is not None
    assert (view.command_id, view.refused, view.outcome) == (5, False, Outcome.NONE)
    assert "resume once more" in view.note
    robot.ask(Operation.RESUME, epoch=2, command_id=6)
    assert moving(robot.run(3.0)[-5:])


def test_what_would_do_nothing_is_refused_with_a_sentence() -> None:
    robot = Robot().started()
    for command_id, operation in ((5, Operation.START), (6, Operation.RESUME)):
        robot.ask(operation, command_id=command_id)
        assert moving(robot.run(1.0))
        view = robot.others.latest(PLAN)
        assert view is not None
        assert (view.command_id, view.refused) == (command_id, True)
        assert view.note.endswith(".")


def test_resume_alone_does_not_start_a_mission() -> None:
    robot = Robot()
    robot.run(0.5)
    robot.ask(Operation.RESUME)
    assert not moving(robot.run(2.0))


def test_long_driving_is_broken_by_short_rests_for_the_gyro() -> None:
    robot = Robot().started()
    robot.turn_to(0.1)
    commands = robot.run(REST_EVERY_S + REST_S + 1.0)
    rested = [c for c in commands if c.speed is Speed.STOP]
    assert rested[-1].t_s - rested[0].t_s == pytest.approx(REST_S, abs=0.3)
    assert [c.yaw_rad for c in rested] == pytest.approx([0.4] * len(rested)), "it turns, and so never comes to rest"
    assert moving(commands[-1:])


@pytest.mark.requirement("PLN_MR_03")
def test_something_ahead_stops_the_robot_within_one_period_and_it_goes_on_when_it_is_gone() -> None:
    robot = Robot().started()
    robot.ranges_m = SOMETHING_AHEAD
    commands = robot.run(0.5)
    first_stop_s = next(c.t_s for c in commands if c.speed is Speed.STOP)
    assert first_stop_s - commands[0].t_s <= 0.11
    assert robot.error() == ErrorCode.EMERGENCY_ROUTINE
    robot.ranges_m = FAR
    assert moving(robot.run(2.0)[-5:])


def test_something_that_stays_is_backed_away_from() -> None:
    robot = Robot().started()
    robot.ranges_m = SOMETHING_AHEAD
    commands = robot.run(3.5)
    assert Speed.REVERSE in {c.speed for c in commands}


def test_something_near_does_not_keep_the_robot_from_turning_away_on_the_spot() -> None:
    """Backing off first would take floor behind it, of which there is none after a turn."""
    robot = Robot().started()
    robot.ask(Operation.GOTO, 1.0, 2.0)  # behind it
    robot.ranges_m = SOMETHING_AHEAD
    commands = robot.run(3.5)
    assert {c.speed for c in commands[5:]} == {Speed.MEDIUM}
    assert all(abs(wrap_angle(c.yaw_rad - 0.3)) > pi / 2 for c in commands[5:])


def test_the_carrier_s_own_backing_off_is_not_disturbed() -> None:
    robot = Robot().started()
    backing = CarrierReport(0.0, CarrierState.BACKING_OFF, 1, 0, 0, -0.1, -80, -80, True, False, 12.0)
    commands = []
    for _ in range(20):
        robot.others.publish(CARRIER, backing)
        robot.planner.step(robot.bus, robot.now_s)
        commands += robot.others.take(DRIVE)
    assert not moving(commands)


@pytest.mark.requirement("PLN_MR_05")
def test_status_comes_ten_times_a_second_with_what_it_is_about() -> None:
    robot = Robot()
    robot.others.take(STATUS["planner"])
    robot.run(3.0)
    statuses = robot.others.take(STATUS["planner"])
    assert len(statuses) == pytest.approx(30, abs=2)
    assert statuses[-1].state == "WAITING"
    assert statuses[-1].ready


def test_people_see_mode_way_and_area() -> None:
    robot = Robot().started()
    robot.ask(Operation.GOTO, 5.0, 2.0)
    robot.run(1.0)
    view = robot.others.latest(PLAN)
    assert view is not None
    assert view.mode == "GOTO"
    assert view.area_m2 == pytest.approx(12.0, rel=0.1)
    assert view.path_m[-1] == pytest.approx([5.0, 2.0], abs=0.5)
    assert view.outcome is Outcome.NONE


def test_goto_ends_where_it_was_asked_for() -> None:
    robot = Robot()
    robot.run(0.5)
    robot.ask(Operation.GOTO, 5.0, 2.0)
    assert moving(robot.run(2.0)[-5:])
    view = robot.others.latest(PLAN)
    assert view is not None
    end_x_m, end_y_m = (float(v) for v in view.path_m[-1])
    assert (end_x_m, end_y_m) == pytest.approx((5.0, 2.0), abs=0.6)
    assert robot.pose is not None
    robot.pose = replace(robot.pose, x_m=end_x_m, y_m=end_y_m)
    assert not moving(robot.run(3.0)[-10:])
    view = robot.others.latest(PLAN)
    assert view is not None
    assert view.outcome is Outcome.ARRIVED


def test_a_place_where_no_floor_is_known_is_refused_and_what_it_does_goes_on() -> None:
    robot = Robot().started()
    robot.ask(Operation.GOTO, 40.0, 40.0, command_id=7)
    assert moving(robot.run(3.0)[-5:])
    view = robot.others.latest(PLAN)
    assert view is not None
    assert (view.command_id, view.refused) == (7, True)
    assert view.note == "No floor is known there on which the robot could stand."
    assert view.mode != "GOTO"


def test_people_see_whether_it_is_paused() -> None:
    robot = Robot().started()
    robot.ask(Operation.PAUSE, command_id=8)
    robot.run(1.0)
    view = robot.others.latest(PLAN)
    assert view is not None
    assert (view.paused, view.note) == (True, "")
    robot.ask(Operation.PAUSE, command_id=9)
    robot.run(1.0)
    view = robot.others.latest(PLAN)
    assert view is not None
    assert (view.paused, view.note) == (True, "It was paused already.")


def test_home_turns_to_the_first_heading_at_the_end() -> None:
    robot = Robot()
    assert robot.pose is not None
    robot.pose = replace(robot.pose, x_m=2.0, y_m=0.0)
    robot.grid = replace(update_of(hall(length_m=6.0)), origin_x_m=-2.0, origin_y_m=-2.0)
    robot.run(0.5)
    robot.ask(Operation.HOME)
    assert moving(robot.run(2.0)[-5:])
    robot.pose = replace(robot.pose, x_m=0.0, y_m=0.0, heading_rad=2.0, yaw_rad=2.3)
    asked = robot.run(3.0)[-1]
    assert asked.speed is Speed.STOP
    assert asked.yaw_rad == pytest.approx(0.3, abs=0.1)
    robot.turn_to(0.0)
    robot.run(1.0)
    view = robot.others.latest(PLAN)
    assert view is not None
    assert view.outcome is Outcome.HOME


def test_a_robot_that_turned_left_by_more_than_half_a_turn_turns_back_to_the_right() -> None:
    robot = Robot()
    assert robot.pose is not None
    robot.pose = replace(robot.pose, x_m=0.0, y_m=0.0)
    robot.grid = replace(update_of(hall(length_m=6.0)), origin_x_m=-2.0, origin_y_m=-2.0)
    for turned_deg in (0.0, 60.0, 120.0, 200.0):
        robot.turn_to(wrap_angle(radians(turned_deg)))
        robot.run(0.5)
    robot.ask(Operation.HOME)
    asked = robot.run(3.0)[-1]
    assert asked.yaw_rad == pytest.approx(0.3 + radians(200.0) - AHEAD_RAD, abs=0.1)


def test_map_increments_out_of_order_do_no_harm() -> None:
    robot = Robot().started()
    for start, count in ((0, 50), (50, 20), (90, 10), (0, 5), (70, 3)):
        points = np.random.default_rng(start).uniform(1.0, 3.0, (count, 2)).astype(np.float32)
        robot.others.publish(MAP, MapUpdate(robot.now_s, 1, start, points, np.zeros(count, np.uint8)))
    assert robot.run(1.0)


@pytest.mark.parametrize("heading_rad", [0.0, -3.0])
@pytest.mark.parametrize("place", [(-20.0, 2.0), (40.0, 40.0), (2.0, -9.0)])
def test_a_pose_off_the_grid_does_no_harm(place: tuple[float, float], heading_rad: float) -> None:
    """A closed loop may shift the map under a robot before the next grid comes."""
    robot = Robot().started()
    assert robot.pose is not None
    robot.pose = replace(robot.pose, x_m=place[0], y_m=place[1])
    robot.turn_to(heading_rad)
    assert robot.run(2.0)


def test_broken_grids_are_told_and_the_last_good_one_stays(caplog: pytest.LogCaptureFixture) -> None:
    robot = Robot().started()
    good = robot.grid
    assert good is not None
    for _ in range(7):
        robot.grid = replace(good, rows=good.rows + 1)
        assert moving(robot.run(1.0))
    assert [line.rpartition(" ")[2] for line in caplog.messages] == ["count=1", "count=2", "count=4"]
    assert all(line.startswith("undecodable topic=mmu/grid error=") for line in caplog.messages)
    robot.grid = update_of(hall(length_m=3.0))
    robot.run(2.0)
    view = robot.others.latest(PLAN)
    assert view is not None
    assert view.area_m2 == pytest.approx(6.0, rel=0.1)


def test_a_grid_where_nothing_is_known_does_no_harm() -> None:
    robot = Robot()
    robot.grid = update_of(drawn([]))
    robot.run(0.5)
    robot.ask(Operation.START)
    assert robot.run(3.0)


def test_a_pose_from_a_far_time_does_not_end_the_steering() -> None:
    robot = Robot().started()
    assert robot.pose is not None
    robot.others.publish(POSE, replace(robot.pose, t_s=1e9))
    robot.planner.step(robot.bus, robot.now_s)
    robot.ask(Operation.PAUSE)
    assert not moving(robot.run(2.0)[-5:])


# Reaction times, by events


class Held(DeferredWorker[Query, Any]):
    """Answers nothing while it is `held`, as if a search took so long."""

    held = False

    def __init__(self) -> None:
        super().__init__(load)

    def result(self, now_s: float) -> JobOutcome[Any] | None:
        return None if self.held else super().result(now_s)

    def due_s(self, now_s: float) -> float:
        return now_s + LOOK_S if self.busy else inf


def stops(command: DriveCommand) -> bool:
    return command.speed is Speed.STOP


def searching_on_a_leg() -> Robot:
    """It drives, and a query of its has no answer."""
    deliberator = Held()
    robot = Robot(deliberator).started()
    deliberator.held = True
    robot.run(2.0)
    assert deliberator.busy
    assert moving(robot.run(0.2))
    return robot


@pytest.fixture(params=[False, True], ids=["nothing asked", "a search runs"])
def driving(request: pytest.FixtureRequest) -> Robot:
    robot = searching_on_a_leg() if request.param else Robot().started()
    robot.run(0.035)  # between two reports
    return robot


@pytest.mark.requirement("PLN_MR_03")
def test_something_near_stops_the_robot_in_the_step_that_its_message_makes_due(driving: Robot) -> None:
    driving.others.publish(RANGES, Ranges(driving.now_s, SOMETHING_AHEAD, (0.0,) * SONAR_COUNT))
    assert driving.run_until(stops, 0.1) <= STEP_GAP_S


def test_a_permit_that_is_lost_stops_the_robot_in_the_step_that_its_message_makes_due(driving: Robot) -> None:
    driving.others.publish(PERMIT, Permit(driving.now_s, False, "a module is missing"))
    assert driving.run_until(stops, 0.1) <= STEP_GAP_S


@pytest.mark.parametrize(("what", "topic"), [("pose", POSE), ("ranges", RANGES)])
def test_an_input_that_stays_away_stops_the_robot_when_it_expires(what: str, topic: Topic[Any], driving: Robot) -> None:
    expires_in_s = ALIVE_PERIODS / topic.rate_hz - driving.bus.age_s(topic)
    lose(driving, what)
    assert expires_in_s <= driving.run_until(stops, 1.0) <= expires_in_s + STEP_GAP_S + TICK_S


def test_a_pause_stands_in_the_step_that_its_message_makes_due(driving: Robot) -> None:
    driving.ask(Operation.PAUSE)
    assert driving.run_until(stops, 0.1) <= STEP_GAP_S


def test_status_and_commands_keep_their_rates_while_a_search_runs() -> None:
    robot = searching_on_a_leg()
    robot.others.take(STATUS["planner"])
    commands = robot.run(3.0)
    assert len(robot.others.take(STATUS["planner"])) == pytest.approx(30, abs=2)
    assert np.diff([c.t_s for c in commands]).max() < 0.1 + LATE_S + STEP_GAP_S


def test_what_comes_together_is_taken_together_and_nothing_else_makes_a_step() -> None:
    robot = Robot().started()
    robot.steps_s.clear()
    robot.run(10.0)
    assert 100 <= len(robot.steps_s) <= 150, "ten reports a second, a grid and its answer each second"


def test_who_waits_for_a_path_stands_and_sets_out_when_it_comes() -> None:
    deliberator = Held()
    robot = Robot(deliberator)
    robot.run(0.5)
    deliberator.held = True
    robot.ask(Operation.GOTO, 5.0, 2.0)
    assert not moving(robot.run(5.0))
    deliberator.held = False
    assert moving(robot.run(0.2))


def test_a_deliberation_that_is_lost_costs_a_stand_until_the_next_grid() -> None:
    class Dying(Held):
        def result(self, now_s: float) -> JobOutcome[Any] | None:
            outcome = super().result(now_s)
            if outcome is None or not self.dies:
                return outcome
            self.dies, self._work = False, None  # the next one has no grid
            return JobOutcome(None, WorkLost("deliberation ended"))

        dies = False

    deliberator = Dying()
    robot = Robot(deliberator)
    robot.run(0.5)
    robot.ask(Operation.GOTO, 5.0, 2.0)
    deliberator.dies = True
    assert moving(robot.run(3.0)[-5:])
    assert not deliberator.dies


def test_of_grids_that_come_while_one_is_read_the_newest_is_read_next() -> None:
    deliberator = Held()
    robot = Robot(deliberator).started()
    deliberator.held = True
    robot.run(3.0)
    assert deliberator.pending == 1
    robot.grid = update_of(hall(length_m=3.0))
    robot.run(1.5)
    robot.grid = None
    deliberator.held = False
    robot.run(1.0)
    view = robot.others.latest(PLAN)
    assert view is not None
    assert view.area_m2 == pytest.approx(6.0, rel=0.1)


def test_no_step_takes_long_on_a_large_floor() -> None:
    """Halls of 60 by 60 m with frontier everywhere; the searches are not part of the steps."""
    deliberator = Held()
    robot = Robot(deliberator)
    free = [(1.0, y_m, 59.0, y_m + 2.0) for y_m in np.arange(1.0, 58.0, 4.0).tolist()]
    free += [(x_m, 1.0, x_m + 2.0, 59.0) for x_m in np.arange(1.0, 58.0, 8.0).tolist()]
    robot.grid = update_of(drawn(free, size_m=(60.0, 60.0)))
    robot.planner = Planner(deliberator, images_walls=True)
    longest_s = 0.0
    robot.ask(Operation.START)
    for tick in range(4_000):
        robot.mesh.now_s = tick * 0.01
        if tick % 10 == 0:
            assert robot.pose is not None
            robot.pose = replace(robot.pose, x_m=2.0 + tick / 1000)
            robot._ticks = 1 if tick % 100 == 0 else 2
            robot._report()
        deliberator.work()
        began_s = time.thread_time()
        robot.planner.step(robot.bus, robot.now_s)
        longest_s = max(longest_s, time.thread_time() - began_s)
    assert longest_s < 0.03
