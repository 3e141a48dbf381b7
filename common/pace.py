"""How often something is done by a node that is stepped when messages come, not evenly. Pure; the time is given."""

from __future__ import annotations

# A step that runs anyway does what is due so soon, and what is due waits so long for such a step: two clocks of nearly
# the same rate then cause one step, not two. Both together stay well below the 0.1 s that a status may be late
EARLY_S = 0.03
LATE_S = 0.02


class Pace:
    """Once in `period_s` on the average, never more often, however unevenly `due` is called."""

    def __init__(self, period_s: float) -> None:
        self.period_s = period_s
        self.due_s = float("-inf")  # the next time

    @property
    def latest_s(self) -> float:
        """When it must be done though no step was made for something else."""
        return self.due_s + LATE_S

    def reset(self) -> None:
        """It is due at once."""
        self.due_s = float("-inf")

    def due(self, now_s: float, urgent: bool = False) -> bool:
        """Now? Then it counts as done. What is urgent is always due."""
        if not urgent and now_s < self.due_s - EARLY_S:
            return False
        on_time = not urgent and now_s < self.due_s + LATE_S
        self.due_s = (self.due_s if on_time else now_s) + self.period_s
        return True
