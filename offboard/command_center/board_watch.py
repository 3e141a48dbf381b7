"""How the robot's computers are, judged on this machine: how old a report is, how far off their clocks are. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from common.constants import BOARD_RATE_HZ
from common.messages.health import BoardState

OLD_S = 3.0 / BOARD_RATE_HZ


@dataclass(frozen=True, slots=True)
class BoardRow:
    """A computer as one line shows it."""

    state: BoardState
    age_s: float
    clock_offset_s: float  # by which its clock is ahead of this machine's, less what the message took

    @property
    def old(self) -> bool:
        return self.age_s > OLD_S


def board_row(state: BoardState, age_s: float, wall_s: float) -> BoardRow:
    """Of a report that arrived `age_s` before `wall_s` (since 1970, by this machine's clock)."""
    return BoardRow(state, age_s, state.wall_s - (wall_s - age_s))
