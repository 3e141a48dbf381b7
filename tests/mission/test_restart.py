"""Everything on the robot ends in the middle of a mission, and goes on from what is on its disk; then five doors.

Half a minute on two cores.
"""

from __future__ import annotations

from collections.abc import Callable
from math import hypot
from pathlib import Path
from typing import Any

import pytest

from common.config import Config
from common.constants import FOOTPRINT_RADIUS_M
from common.messages.mission import Operation, Outcome
from common.messages.topics import MAP, ZONES
from common.wall_points import WallPointMap
from common.zones import zones_of
from offboard.simulator.run.lockstep import Lockstep
from offboard.simulator.run.side_workers import SideWorkers
from offboard.simulator.stopwatch import Stopwatch
from onboard.bridge.bridge import Bridge
from onboard.comm.comm import Comm
from onboard.mmu.back_end.map_builder import deferred_back_end
from onboard.mmu.map.map_file import MAP_NAME, load_map
from onboard.mmu.mmu import MappingUnit, carrier_of
from onboard.planner.grid.deliberation import deferred_deliberator
from onboard.planner.planner import Planner
from onboard.planner.zones.zone_file import ZONES_NAME
from onboard.planner.zones.zone_keeper import ZoneKeeper
from tests.mission.story import Story
from tests.mission.test_kept_out import END_S, FAR_END, START, driven, least_gap_m, on_map, side_hall

__all__ = ["side_hall"]

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

Tell = Callable[..., Story]

DOORS = ((2.0, 0.0), (4.5, 1.6), (7.0, 0.0), (5.0, 3.5), (6.6, 2.6))  # on the walls of the floor


def no_reading(_: object) -> Any:
    raise AssertionError("there is no camera")


def workers(folder: Path) -> SideWorkers:
    """A back end that saves its map there."""
    back_end, deliberator = deferred_back_end(folder / MAP_NAME), deferred_deliberator()

    def work() -> None:
        back_end.work()
        deliberator.work()

    return SideWorkers(back_end, deliberator, no_reading, work)


def started_anew(story: Story, folder: Path) -> Story:
    """All programs of the robot, with what their disks hold. The board goes on: it has its own power."""
    for slot in story.robot.slots:
        slot.node.close()
    simulation, beside, config = story.robot.simulation, workers(folder), Config()
    planner = Planner(beside.deliberator, boot=2, zones=ZoneKeeper(folder / ZONES_NAME))
    mmu = MappingUnit(beside.back_end, carrier_of(config), load_map(folder / MAP_NAME))
    nodes = [Bridge(lambda: simulation.port), mmu, planner, Comm(config.comm)]
    return Story(Lockstep(simulation, nodes, seed=2, beside=beside.work))


def from_map_m(story: Story, place: tuple[float, float]) -> float:
    """How far the nearest wall point of the map is from a place of the floor."""
    points = WallPointMap()
    for update in story.robot.operator.take(MAP):
        points.apply(update)
    x_m, y_m = on_map(place)[0]
    near = points.near(x_m, y_m, 1.0)
    return min((hypot(x - x_m, y - y_m) for x, y in near.tolist()), default=1.0)


@pytest.mark.requirement("PLN_MR_01", "MMU_MR_02")
def test_a_mission_goes_on_after_a_restart_of_everything_and_then_leads_to_five_doors(
    side_hall: Path, tell: Tell, tmp_path: Path
) -> None:
    def beside(_: Stopwatch) -> SideWorkers:
        return workers(tmp_path)

    story = tell(side_hall, seed=3, beside=beside)
    planner = next(slot.node for slot in story.robot.slots if slot.node.name == "planner")
    assert isinstance(planner, Planner)
    planner._zones = ZoneKeeper(tmp_path / ZONES_NAME)
    assert story.until(story.granted, 60.0)
    story.draw(Operation.NO_GO_AREA, *FAR_END)
    story.start()
    assert story.until(lambda: story.world.truth.x_m > 4.5 and (tmp_path / MAP_NAME).exists(), 300.0)
    story.run(1.0)

    again = started_anew(story, tmp_path)
    again.robot.operator.take(MAP)
    again.robot.operator.latest(ZONES)
    again.run(5.0)
    zones = again.robot.operator.latest(ZONES)
    assert zones is not None
    assert zones_of(zones)[0].corners_m == FAR_END
    again.start()
    assert again.until(again.ended, END_S)
    assert again.view().outcome is Outcome.FINISHED
    assert hypot(again.world.truth.x_m - START[0], again.world.truth.y_m - START[1]) < 0.5
    assert least_gap_m(again) > 0.0
    assert driven(again)[:, 1].max() > 1.5, "it explored the side hall"
    assert from_map_m(again, (2.0, 0.0)) < 0.15, "the map of before the restart is part of it"

    for door in DOORS:
        again.say(Operation.GOTO, *on_map(door)[0])
        again.run(1.0)
        assert again.until(lambda: again.view().outcome is Outcome.ARRIVED, 300.0), door
        truth = again.world.truth
        assert hypot(truth.x_m - door[0], truth.y_m - door[1]) - FOOTPRINT_RADIUS_M < 0.3, door
