"""No-go lines and areas, and areas to stay in: by the true pose the hull stays out, and it says what it left."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from common.constants import FOOTPRINT_RADIUS_M
from common.messages.mission import Operation, Outcome
from common.messages.topics import MAP, ZONES
from common.zones import gap_m, zones_of
from tests.mission.conftest import floor_file
from tests.mission.story import Story

Tell = Callable[..., Story]

START = (1.0, 0.8)  # of the robot on the floor: there the map begins
END_S = 1500.0


@pytest.fixture(scope="session")
def side_hall(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A hall of 10 m with a side hall in the middle of its left wall."""
    ring = [[0, 0], [10, 0], [10, 1.6], [6.6, 1.6], [6.6, 5], [5, 5], [5, 1.6], [0, 1.6]]
    return floor_file(
        tmp_path_factory.mktemp("floors"), "side hall", [[float(x), float(y)] for x, y in ring], [], START
    )


def on_map(*places: tuple[float, float]) -> tuple[tuple[float, float], ...]:
    return tuple((x - START[0], y - START[1]) for x, y in places)


def driven(story: Story) -> np.ndarray:
    """Where the robot truly was, on the map's axes (N, 2)."""
    return np.array([(x, y) for _, x, y, _ in story.world.truth_log]) - START


def least_gap_m(story: Story) -> float:
    """Between the hull and what keeps it out, over all of the drive."""
    message = story.robot.operator.latest(ZONES)
    assert message is not None
    zones = zones_of(message)
    return min(gap_m(zones, x_m, y_m) for x_m, y_m in driven(story).tolist()) - FOOTPRINT_RADIUS_M


MOUTH = on_map((4.8, 1.6), (6.8, 1.6))
FAR_END = on_map((8.0, -0.5), (10.5, -0.5), (10.5, 2.5), (8.0, 2.5))


@pytest.mark.timeout(300)
@pytest.mark.requirement("PLN_MR_01", "CC_MR_04")
def test_hull_stays_out_of_lines_and_areas_and_what_lies_behind_is_listed(side_hall: Path, tell: Tell) -> None:
    story = tell(side_hall, seed=2)
    assert story.until(story.granted, 60.0)
    story.draw(Operation.NO_GO_LINE, *MOUTH)
    story.draw(Operation.NO_GO_AREA, *FAR_END)
    story.start()
    assert story.until(story.ended, END_S)
    view = story.view()
    assert view.outcome is Outcome.FINISHED
    assert driven(story)[:, 0].max() > 5.5, "it drove on past the line"
    assert least_gap_m(story) > 0.0
    assert [place for place in view.blacklisted if "no-go" in place], "the side hall, whose end no sonar has seen"
    assert "left out" in view.detail

    story.say(Operation.GOTO, *on_map((9.0, 0.8))[0])
    story.run(1.0)
    assert story.view().mode == "DONE", "it is refused"
    story.say(Operation.REMOVE_ZONE)
    story.run(2.0)
    story.say(Operation.GOTO, *on_map((5.8, 3.0))[0])
    assert story.until(lambda: story.view().outcome is Outcome.ARRIVED, 200.0)


@pytest.mark.timeout(300)
@pytest.mark.requirement("PLN_MR_01")
def test_hull_stays_in_the_area_to_stay_in_and_keeps_to_a_line_drawn_before_its_wheels(
    side_hall: Path, tell: Tell
) -> None:
    story = tell(side_hall, seed=2)
    story.start()
    story.draw(Operation.ONLY_HERE, *on_map((-0.5, -0.5), (8.0, -0.5), (8.0, 2.5), (-0.5, 2.5)))
    assert story.until(lambda: story.world.truth.x_m > 2.5 and story.drives(), 200.0)
    story.draw(Operation.NO_GO_LINE, *on_map((4.2, -0.5), (4.2, 3.0)))
    assert story.until(story.ended, END_S)
    assert story.view().outcome is Outcome.FINISHED
    assert driven(story)[:, 0].max() > 1.5
    assert least_gap_m(story) > 0.0
    assert story.view().blacklisted
    assert story.robot.operator.latest(MAP) is not None
