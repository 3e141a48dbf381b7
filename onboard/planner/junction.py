"""The choice where a leg has ended: which ways on show new floor, and which of them the right-hand rule takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from common.geometry import Pose2
from onboard.planner.exploration import STRAIGHT_SIDE_M
from onboard.planner.prospects import Prospects
from onboard.planner.right_hand_rule import Turn, decide
from onboard.planner.setbacks import TriedWays
from onboard.planner.view import View

SIDE_REACH_M = 1.2
SIDE_WIDTH_M = 0.8


class Junction:
    """Asked at every stop; remembers the ways that were tried."""

    def __init__(self) -> None:
        self._tried = TriedWays()
        self._choice_due = False  # a leg has ended, and no way on is chosen yet

    def end_leg(self, start: Pose2, end: Pose2) -> None:
        """A straight leg has led the robot here."""
        self._tried.add_leg(start, end)
        self._choice_due = True

    def choose(self, view: View, prospects: Prospects, ways_rad: Mapping[Turn, float]) -> Turn | None:
        """P3.0: the right-most of the ways, given by their headings, that shows new floor; None where none does."""
        open_ways = {turn for turn, way_rad in ways_rad.items() if self._shows_new(view, prospects, turn, way_rad)}
        # A way that was chosen is driven before the next choice, or the robot would go round and round on the spot
        forward = Turn.FORWARD in open_ways and not self._choice_due
        self._choice_due = False
        turn = Turn.FORWARD if forward else decide(open_ways)
        if turn not in open_ways:
            return None
        if turn is not Turn.FORWARD:
            self._tried.add_side(replace(view.pose, heading_rad=ways_rad[turn]))
        return turn

    def _shows_new(self, view: View, prospects: Prospects, turn: Turn, way_rad: float) -> bool:
        """Would driving straight that way show new floor? To a side only what lies near the axis counts."""
        way = replace(view.pose, heading_rad=way_rad)
        if turn is Turn.FORWARD:
            ruled_out = view.front_is_near or self._tried.leg_in_vain(view.pose)
            width_m = STRAIGHT_SIDE_M
        else:
            ruled_out = prospects.straight_reach_m(view, way) < SIDE_REACH_M or self._tried.tried(way)
            width_m = SIDE_WIDTH_M
        return not ruled_out and prospects.something_ahead(view, way, width_m)
