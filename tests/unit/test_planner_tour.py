"""Tours home past the places of the list, and the walking distances that they are made of."""

from __future__ import annotations

from itertools import pairwise, permutations
from math import inf

import numpy as np
import pytest

from onboard.planner.routing.route_planning import cell_prices
from onboard.planner.routing.tour import tours_m
from onboard.planner.routing.walking_distances import WalkingDistances
from tests.unit.test_planner_grid_map import drawn
from tests.unit.test_planner_route_planning import two_rooms


def test_tours_are_the_shortest_of_all_orders() -> None:
    places = np.random.default_rng(4).uniform(0.0, 50.0, (7, 2))
    d = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    for first, length_m in enumerate(tours_m(d), 1):
        orders = ((0, first, *rest, 6) for rest in permutations({1, 2, 3, 4, 5} - {first}))
        assert length_m == pytest.approx(min(sum(d[a, b] for a, b in pairwise(order)) for order in orders))


def test_a_place_on_the_way_home_is_left_for_the_way_home_at_no_cost() -> None:
    x = np.array([0.0, 5.0, -8.0, -30.0])  # here, ahead, behind, home
    ahead_m, behind_m = tours_m(np.abs(x[:, None] - x[None]))
    assert ahead_m == pytest.approx(5.0 + 35.0)
    assert behind_m == pytest.approx(8.0 + 13.0 + 35.0)


def test_no_place_is_no_tour() -> None:
    assert tours_m(np.zeros((2, 2))) == []


def test_walking_distances_lead_round_the_wall_and_nowhere_through_it() -> None:
    grid = two_rooms(1.6)
    here, there = grid.cell(2.0, 1.6), grid.cell(8.0, 1.6)
    walking = WalkingDistances(cell_prices(grid, here), grid.cell_m)
    assert 6.5 < walking.of(here, [there])[0] < 14.0
    assert walking.of(there, [here]) == walking.of(here, [there])
    closed = drawn([(0.0, 0.0, 10.0, 4.0)], [(5.0, 0.0, 5.1, 4.0)])
    assert WalkingDistances(cell_prices(closed, here), closed.cell_m).of(here, [there, here]).tolist() == [inf, 0.0]
