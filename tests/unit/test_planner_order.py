"""Which entries of the list may come next, and what it costs to begin with each."""

from __future__ import annotations

import numpy as np
import pytest

from common.geometry import Pose2
from onboard.planner.exploration.frontiers import FrontierGroup
from onboard.planner.exploration.order import FAR_FOR_SMALL_M, SLACK_M, worthwhile
from onboard.planner.exploration.queries import Offer, PlanTours
from onboard.planner.grid.deliberation import Grids
from onboard.planner.grid.grid_map import GridMap
from tests.unit.test_planner_grid_map import drawn, hall


def group(width_m: float) -> FrontierGroup:
    points = np.array([[0.0, 0.0], [width_m, 0.0]])
    return FrontierGroup(np.zeros((2, 2), dtype=np.int64), points, 0.0, 0.0)


WIDE, OTHER, SMALL = group(2.0), group(1.5), group(0.3)


def asked(grid: GridMap, here: tuple[float, float], *entries: tuple[float, float]) -> tuple[Offer, ...]:
    grids = Grids()
    grids.put(1, grid)
    cells = tuple(grid.cell(*entry) for entry in entries)
    return PlanTours(1, Pose2(*here, 0.0), cells, (2.0, 2.0), ()).answer(grids)


@pytest.mark.requirement("PLN_MR_01")
def test_what_is_near_comes_before_the_far_end_that_the_robot_would_come_back_from() -> None:
    """Home at x = 2; the robot stands at x = 10 with an entry just behind it and one at the far end."""
    near, far = asked(hall(20.0), (10.0, 2.0), (9.0, 2.0), (20.0, 2.0))
    assert (near.entry, far.entry) == (0, 1)
    assert near.distance_m == pytest.approx(1.0, abs=0.5)
    assert near.detour_m == pytest.approx(0.0, abs=0.5)
    assert far.tour_m == pytest.approx(10.0 + 18.0, abs=1.0)  # the other one lies on its way home
    assert worthwhile([(WIDE, near), (OTHER, far)]) == [WIDE, OTHER]


def test_entries_that_no_path_leads_to_are_not_offered() -> None:
    closed = drawn([(0.0, 0.0, 10.0, 4.0)], [(5.0, 0.0, 5.1, 4.0)])
    assert [offer.entry for offer in asked(closed, (2.0, 2.0), (8.0, 2.0), (4.0, 2.0))] == [1]
    assert asked(closed, (2.0, 2.0)) == ()


def test_an_order_that_costs_more_than_others_is_not_worthwhile() -> None:
    offers = [(WIDE, Offer(0, 3.0, 6.0, 40.0 + SLACK_M + 1.0)), (OTHER, Offer(1, 5.0, 10.0, 40.0))]
    assert worthwhile(offers) == [OTHER]


def test_a_last_crumb_is_no_reason_for_a_long_way() -> None:
    assert worthwhile([(SMALL, Offer(0, 30.0, FAR_FOR_SMALL_M + 1.0, 60.0))]) == []
    assert worthwhile([(SMALL, Offer(0, 3.0, FAR_FOR_SMALL_M - 1.0, 60.0))]) == [SMALL]
    assert worthwhile([(WIDE, Offer(0, 30.0, 60.0, 90.0))]) == [WIDE]
