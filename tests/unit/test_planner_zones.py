"""Zones in the planner: cells that are no floor, a border that stops like an echo, orders and their answers."""

from __future__ import annotations

from math import inf, nan, pi, radians
from pathlib import Path

import numpy as np
import pytest

from common.constants import FOOTPRINT_RADIUS_M
from common.errors import ErrorCode
from common.geometry import Pose2
from common.grid_cells import WALL
from common.messages.mission import Operation, OperatorCommand, Outcome, PlannerView
from common.messages.motion import Speed
from common.messages.topics import PLAN, ZONES
from common.zones import Zone, ZoneKind, gap_m, zones_of
from onboard.planner.exploration.queries import FindPath, JudgedGrid, JudgeGrid, JudgeLeftOut
from onboard.planner.grid.deliberation import Grids
from onboard.planner.grid.grid_reading import GridReader, without_zones
from onboard.planner.zones.zone_file import ZONES_NAME
from onboard.planner.zones.zone_guard import ZoneGuard, with_border
from onboard.planner.zones.zone_keeper import ZoneKeeper
from tests.unit.test_planner_grid_map import hall, update_of
from tests.unit.test_planner_node import Robot

HERE = Pose2(0.0, 0.0, 0.0)
LINE = Zone(1, ZoneKind.LINE, ((4.0, 0.0), (4.0, 4.0)))
AREA = Zone(2, ZoneKind.AREA, ((3.0, 1.0), (5.0, 1.0), (5.0, 3.0), (3.0, 3.0)))
ONLY = Zone(3, ZoneKind.ONLY, ((1.0, 0.0), (4.0, 0.0), (4.0, 4.0), (1.0, 4.0)))


def order(operation: Operation, *corners: tuple[float, float], zone: int = 0, command_id: int = 0) -> OperatorCommand:
    xs, ys = tuple(x for x, _ in corners), tuple(y for _, y in corners)
    return OperatorCommand(0.0, operation, corners_x_m=xs, corners_y_m=ys, zone=zone, command_id=command_id)


@pytest.mark.parametrize("zone", [LINE, AREA, ONLY])
def test_wherever_the_footprint_may_stand_it_keeps_clear_of_a_zone(zone: Zone) -> None:
    grid = GridReader().read(update_of(hall()), (zone,))
    standing = grid.centres(np.argwhere(grid.standable()))
    gaps = [gap_m((zone,), x_m, y_m) for x_m, y_m in standing.tolist()]
    assert min(gaps) > FOOTPRINT_RADIUS_M + 0.15
    assert min(gaps) < FOOTPRINT_RADIUS_M + 0.45
    assert (grid.cells == WALL).sum() == (GridReader().read(update_of(hall())).cells == WALL).sum()


def test_without_its_zones_a_grid_is_what_it_was() -> None:
    bare = GridReader().read(update_of(hall()))
    lifted = without_zones(GridReader().read(update_of(hall()), (AREA, LINE)))
    assert (lifted.cells == bare.cells).mean() > 0.999
    assert without_zones(bare) is bare


def asked(query: JudgeGrid) -> tuple[Grids, JudgedGrid]:
    grids = Grids()
    judged = query.answer(grids)
    assert isinstance(judged, JudgedGrid)
    return grids, judged


def test_no_path_leads_over_a_line_and_the_end_behind_it_is_listed_as_left_out() -> None:
    update, pose = update_of(hall(length_m=6.0, closed=False)), Pose2(2.0, 2.0, 0.0)
    nothing = np.zeros((0, 2))
    open_grids, open_end = asked(JudgeGrid(1, pose, (), (), nothing, 0, update))
    grids, judged = asked(JudgeGrid(1, pose, (), (), nothing, 0, update, (LINE,)))
    beyond = {open_grids.of(1).cell(5.0, 2.0)}
    assert FindPath(1, pose, beyond, ()).answer(open_grids)
    assert FindPath(1, pose, beyond, ()).answer(grids) is None
    assert any(group.x_m > 4.0 for group in open_end.groups)
    assert not any(group.x_m > 4.0 for group in judged.groups)
    left_out = JudgeLeftOut(1, pose, nothing).answer(grids)
    assert {group.x_m > 4.0: kept_out for group, kept_out in left_out}.get(True) is True
    assert all(kept_out is (group.x_m > 4.0) for group, kept_out in left_out)


def test_the_guard_finds_the_border_ahead_of_the_hull_and_none_that_it_passes() -> None:
    guard = ZoneGuard((Zone(1, ZoneKind.LINE, ((1.0, -1.0), (1.0, 1.0))),))
    assert guard.room_m(HERE, 0.0) == pytest.approx(1.0 - FOOTPRINT_RADIUS_M, abs=0.04)
    assert guard.room_m(HERE, pi) == inf
    assert guard.room_m(HERE, pi / 2) == inf
    beside = ZoneGuard((Zone(1, ZoneKind.LINE, ((-3.0, 0.3), (3.0, 0.3))),))
    assert beside.room_m(HERE, 0.0) == inf
    assert beside.room_m(HERE, radians(30.0)) < 0.3


def test_the_guard_finds_a_corner_that_stands_between_its_rays() -> None:
    spike = ((0.8, 0.12), (1.5, 0.121), (1.5, 0.119))
    assert ZoneGuard((Zone(1, ZoneKind.AREA, spike),)).room_m(HERE, 0.0) < 0.62


def test_a_robot_that_got_into_a_zone_may_leave_it_and_go_no_deeper() -> None:
    area = Zone(1, ZoneKind.AREA, ((-0.5, -1.0), (3.0, -1.0), (3.0, 1.0), (-0.5, 1.0)))
    assert ZoneGuard((area,)).room_m(HERE, pi) == inf
    only = Zone(1, ZoneKind.ONLY, ((0.5, -1.0), (3.0, -1.0), (3.0, 1.0), (0.5, 1.0)))
    assert ZoneGuard((only,)).room_m(HERE, 0.0) == inf
    two = (only, Zone(2, ZoneKind.ONLY, ((2.0, -1.0), (6.0, -1.0), (6.0, 1.0), (2.0, 1.0))))
    assert ZoneGuard(two).room_m(Pose2(1.5, 0.0, 0.0), 0.0) == inf, "no border inside of their union"


def test_a_border_is_heard_as_an_echo_to_the_front_unless_another_is_nearer() -> None:
    assert with_border((1.0, nan, nan, nan, 1.0), 0.5)[2] == pytest.approx(0.5 + FOOTPRINT_RADIUS_M)
    assert with_border((1.0, nan, 0.4, nan, 1.0), 0.5)[2] == 0.4
    assert with_border((1.0, nan, 0.4, nan, 1.0), inf)[2] == 0.4


@pytest.mark.parametrize(
    ("command", "refused"),
    [
        (order(Operation.NO_GO_LINE, (3.0, -1.0), (3.0, 1.0)), False),
        (order(Operation.NO_GO_LINE, (0.3, -1.0), (0.3, 1.0)), True),
        (order(Operation.NO_GO_LINE, (3.0, 1.0)), True),
        (order(Operation.NO_GO_AREA, (-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)), True),
        (order(Operation.ONLY_HERE, (-1.0, -1.0), (4.0, -1.0), (4.0, 1.0), (-1.0, 1.0)), False),
        (order(Operation.ONLY_HERE, (2.0, -1.0), (4.0, -1.0), (4.0, 1.0), (2.0, 1.0)), True),
        (order(Operation.REMOVE_ZONE, zone=7), True),
    ],
)
def test_what_would_hold_the_robot_or_its_home_is_refused(command: OperatorCommand, refused: bool) -> None:
    keeper = ZoneKeeper()
    answer = keeper.order(command, HERE)
    assert answer.refused is refused
    assert len(keeper.zones) == (not refused)
    assert answer.note.endswith(".")


def stored(keeper: ZoneKeeper) -> None:
    keeper.step(0.0)
    keeper.close()


def test_zones_outlive_a_restart_and_numbers_are_not_used_again_while_they_count(tmp_path: Path) -> None:
    file = tmp_path / ZONES_NAME
    keeper = ZoneKeeper(file)
    for x_m in (3.0, 4.0):
        assert not keeper.order(order(Operation.NO_GO_LINE, (x_m, -1.0), (x_m, 1.0)), HERE).refused
    assert not keeper.order(order(Operation.REMOVE_ZONE, zone=1), HERE).refused
    stored(keeper)
    again = ZoneKeeper(file)
    assert [zone.number for zone in again.zones] == [2]
    assert again.forbids((3.0, 0.0)) is False
    assert not again.order(order(Operation.REMOVE_ZONE), HERE).refused
    stored(again)
    assert ZoneKeeper(file).zones == ()


@pytest.mark.parametrize("text", ["{", "[1]", '[{"number": 1, "kind": "no-go-line", "corners_m": [[0, 0]]}]', "7"])
def test_zones_that_cannot_be_read_keep_the_robot_where_it_is_until_they_are_removed(tmp_path: Path, text: str) -> None:
    file = tmp_path / ZONES_NAME
    file.write_text(text, encoding="utf-8")
    keeper = ZoneKeeper(file)
    assert keeper.damaged
    robot = Robot(zones=keeper)
    robot.ask(Operation.START)
    assert {command.speed for command in robot.run(3.0)} == {Speed.STOP}
    assert robot.error() == ErrorCode.ZONES_LOST
    robot.order(order(Operation.REMOVE_ZONE, command_id=9))
    robot.run(1.0)
    assert not keeper.damaged
    assert robot.error() == ErrorCode.OK


def view_of(robot: Robot) -> PlannerView:
    view = robot.others.latest(PLAN)
    assert view is not None
    return view


def test_the_planner_answers_publishes_and_obeys_what_is_drawn() -> None:
    robot = Robot()
    robot.others.latest(ZONES)
    robot.run(2.0)
    corners = ((3.0, 1.0), (5.0, 1.0), (5.0, 3.0), (3.0, 3.0))
    robot.order(order(Operation.NO_GO_AREA, *corners, command_id=5))
    robot.run(0.1)
    view = view_of(robot)
    assert (view.command_id, view.refused) == (5, False)
    message = robot.others.latest(ZONES)
    assert message is not None
    assert zones_of(message) == (Zone(1, ZoneKind.AREA, corners),)
    robot.ask(Operation.GOTO, 4.0, 2.0, command_id=6)
    robot.run(1.0)
    view = view_of(robot)
    assert (view.command_id, view.refused, view.mode) == (6, True, "WAITING")
    assert "no-go" in view.note


def test_a_grid_that_stays_as_it_is_is_read_anew_when_a_line_is_drawn() -> None:
    robot = Robot()
    robot.run(2.0)
    robot.grid = None
    robot.ask(Operation.GOTO, 5.0, 2.0)
    robot.run(2.0)
    assert view_of(robot).mode == "GOTO"
    robot.order(order(Operation.NO_GO_LINE, (3.5, 0.0), (3.5, 4.0)))
    robot.run(2.0)
    assert view_of(robot).outcome is Outcome.GAVE_UP
    assert "no-go line" in view_of(robot).detail
    robot.order(order(Operation.REMOVE_ZONE, zone=1))
    robot.run(1.0)
    robot.ask(Operation.GOTO, 5.0, 2.0)
    robot.run(2.0)
    assert "no-go line" not in view_of(robot).detail
    assert view_of(robot).mode == "GOTO"
