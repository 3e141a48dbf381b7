"""A loop closure that was tried, and the gates that it must pass."""

from __future__ import annotations

from dataclasses import dataclass

from onboard.mmu.front_end.scan_matching import Match

# Gates. Tuned on recorded robots (range logs); how the share of wrong closures depends on each value was not measured
OVERLAP_MIN = 0.55
RMS_MAX_M = 0.07
POINTS_MIN = 25
AMBIGUITY_MAX = 0.9  # score of the second-best place over that of the best
ADOPTED_CHI2_MAX = 12.0  # at rest; a larger one means that the graph does not agree. (99.3 % of right ones, 3 dof)

# What fails the gate of overlap or of points counts with others that say the same, from here on
WEAK_OVERLAP_MIN = 0.35
WEAK_POINTS_MIN = 15


@dataclass(frozen=True, slots=True)
class Attempt:
    """A loop closure that was tried between the nodes `anchor` and `node`."""

    anchor: int
    node: int
    points: int  # that were matched
    match: Match | None

    @property
    def failed_gate(self) -> str | None:
        """The first gate of the scan match that it does not pass; None where it passes all."""
        match = self.match
        if match is None:
            return "no match"
        gates = {
            "overlap": match.overlap < OVERLAP_MIN,
            "rms": match.rms_m > RMS_MAX_M,
            "points": match.overlap * self.points < POINTS_MIN,
            "ambiguous": match.ambiguity > AMBIGUITY_MAX,
        }
        return next((name for name, failed in gates.items() if failed), None)

    @property
    def weak(self) -> bool:
        """May it be right, so that it counts where others say the same?"""
        match = self.match
        return (
            match is not None
            and match.overlap >= WEAK_OVERLAP_MIN
            and match.rms_m <= RMS_MAX_M
            and match.overlap * self.points >= WEAK_POINTS_MIN
        )

    def line(self, verdict: str, chi2: float | None = None) -> str:
        """One line for the log: each figure beside its gate."""
        text = f"loop closure {verdict} anchor={self.anchor} node={self.node}"
        if self.match is not None:
            text += (
                f" overlap={self.match.overlap:.2f} (min {OVERLAP_MIN:g})"
                f" rms_m={self.match.rms_m:.3f} (max {RMS_MAX_M:g})"
                f" points={self.match.overlap * self.points:.0f} (min {POINTS_MIN})"
                f" ambiguity={self.match.ambiguity:.2f} (max {AMBIGUITY_MAX:g})"
            )
        return text if chi2 is None else f"{text} chi2={chi2:.1f} (max {ADOPTED_CHI2_MAX:g})"
