"""The choice where a leg has ended: which branches show new floor, and which of them the right-hand rule takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum

from common.geometry import Pose2
from onboard.planner.exploration.frontier_manager import FrontierManager
from onboard.planner.exploration.frontiers import STRAIGHT_SIDE_M, Frontier
from onboard.planner.exploration.recovery_memory import TriedBranches
from onboard.planner.exploration.right_hand_rule import Turn, decide
from onboard.planner.grid.view import View

SIDE_REACH_M = 1.2
SIDE_WIDTH_M = 0.8


class Branch(Enum):
    """What driving straight along a branch would bring."""

    NEW = "shows new floor"
    KNOWN = "shows nothing new"
    NO_ROOM = "too short"
    TRIED = "was tried"


@dataclass(frozen=True, slots=True)
class Choice:
    """The branch that is taken, None where none is, and how each was judged."""

    turn: Turn | None
    branches: Mapping[Turn, Branch]

    def __str__(self) -> str:
        branches = " ".join(f"{turn.name}={branch.name}" for turn, branch in self.branches.items())
        return f"taken={self.turn.name if self.turn is not None else 'NONE'} {branches}"


class Junction:
    """Called at every stop; remembers the branches that were tried."""

    def __init__(self) -> None:
        self._tried = TriedBranches()
        self._choice_due = False  # a leg has ended, and no branch is chosen yet

    def end_leg(self, start: Pose2, end: Pose2) -> None:
        """A straight leg has led the robot here."""
        self._tried.add_leg(start, end)
        self._choice_due = True

    def choose(
        self, view: View, frontiers: FrontierManager, headings_rad: Mapping[Turn, float], of: Frontier
    ) -> Choice:
        """P3.0: the right-most of the branches, given by their headings, that shows some of that frontier; None where
        none does."""
        found = {turn: self._judged(view, frontiers, turn, rad, of) for turn, rad in headings_rad.items()}
        open_turns = {turn for turn, judged in found.items() if judged is Branch.NEW}
        # A branch that was chosen is driven before the next choice: otherwise the robot would keep turning on the spot
        forward = Turn.FORWARD in open_turns and not self._choice_due
        self._choice_due = False
        turn = Turn.FORWARD if forward else decide(open_turns)
        if turn not in open_turns:
            return Choice(None, found)
        if turn is not Turn.FORWARD:
            self._tried.add_side(replace(view.pose, heading_rad=headings_rad[turn]))
        return Choice(turn, found)

    def _judged(self, view: View, frontiers: FrontierManager, turn: Turn, heading_rad: float, of: Frontier) -> Branch:
        """Would driving straight along this branch show new floor? To a side only what lies near the axis counts."""
        branch = replace(view.pose, heading_rad=heading_rad)
        if turn is Turn.FORWARD:
            no_room, tried = view.front_is_near or view.hall_bends, self._tried.leg_in_vain(view.pose)
            width_m = STRAIGHT_SIDE_M
        else:
            no_room = frontiers.straight_reach_m(view, branch) < SIDE_REACH_M
            tried, width_m = self._tried.tried(branch), SIDE_WIDTH_M
        if no_room or tried:
            return Branch.NO_ROOM if no_room else Branch.TRIED
        return Branch.NEW if frontiers.something_ahead(view, branch, width_m, of) else Branch.KNOWN
