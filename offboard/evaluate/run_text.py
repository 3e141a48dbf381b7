"""What a run prints for the person in front of it, live and at its end. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from common.messages.mission import PlannerView
from common.messages.stop import Permit
from common.mission_state import mission_state

HEADLINE = ("coverage", "map_rmse_m", "home_m", "clearance_m", "ate_fit_m")


def progress(time_s: float, view: PlannerView, permit: Permit | None) -> str:
    """How far the mission is, and why the robot stands where it may not move."""
    state = mission_state(view, permit)
    standing = "" if permit is None or permit.granted else f", standing: {permit.reason}"
    return f"{time_s:7.0f} s  {view.area_m2:6.1f} m2 mapped, side halls: {state.halls}, {state.text}{standing}"


def figures(summary: Mapping[str, Any], names: Sequence[str] = HEADLINE) -> list[str]:
    """Each of these figures that the summary has, with its name."""
    return [f"{name} {summary[name]:.3f}" for name in names if isinstance(summary.get(name), float)]
