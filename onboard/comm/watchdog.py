"""Which required module is missing, and may the robot move as far as the modules go (CM_MR_02)? Pure.

A module is sound while its Zenoh token is up (its process runs), its status is fresh and its heartbeat count advances
(its own loop runs), and it reports that it is ready. The first fault withdraws the permit; once all modules have been
sound for WATCHDOG_CLEAR_S it is granted again.

The specification's Watch Dog Timer: `fault_of` checks what its `trigger_timer` checks, and its `interrupt` is the
permit that `Comm` withdraws: without a permit the robot stands.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from common.constants import STARTUP_GRACE_S, STATUS_RATE_HZ, WATCHDOG_CLEAR_S
from common.modules import ON_ROBOT
from common.release import Release

# Two periods: with the period of comm and the way there, a frozen module costs less than the 250 ms that are allowed
STATUS_AGE_MAX_S = 2.0 / STATUS_RATE_HZ


@dataclass(frozen=True, slots=True)
class ModuleReading:
    """What comm knows of one module; ages by arrival, infinite when nothing ever came."""

    token: bool
    status_age_s: float
    heartbeat_age_s: float
    ready: bool
    state: str = ""


@dataclass(frozen=True, slots=True)
class WatchdogState:
    started_s: float
    sound_since_s: float | None = None
    ever_granted: bool = False


@dataclass(frozen=True, slots=True)
class Verdict:
    granted: bool
    reason: str  # one sentence, empty when granted
    starting: bool = False  # nothing is wrong yet: modules are still coming up


def fault_of(module: str, reading: ModuleReading) -> str | None:
    """What is wrong with a module, in words for people; None when nothing is."""
    if not reading.token:
        return f"{module} is not running"
    if reading.status_age_s > STATUS_AGE_MAX_S:
        return f"{module} is silent"
    if reading.heartbeat_age_s > STATUS_AGE_MAX_S:
        return f"the loop of {module} stands still"
    if not reading.ready:
        return f"{module} is not ready ({reading.state})"
    return None


def silent_in_s(readings: Mapping[str, ModuleReading]) -> float:
    """In how many seconds the first of the modules that report falls silent if nothing comes; infinite without one."""
    ages_s = [age_s for reading in readings.values() for age_s in (reading.status_age_s, reading.heartbeat_age_s)]
    return min((STATUS_AGE_MAX_S - age_s for age_s in ages_s if age_s <= STATUS_AGE_MAX_S), default=float("inf"))


def release_faults(releases: Iterable[tuple[str, Release]], own: Release) -> list[str]:
    """Which modules on the robot have another message table than comm, in words for people."""
    return [
        f"{module} runs release {release.name}, comm release {own.name}"
        for module, release in sorted(releases, key=lambda known: known[0])
        if module in ON_ROBOT and release.messages != own.messages
    ]


def watch(
    state: WatchdogState, readings: Mapping[str, ModuleReading], now_s: float, further_faults: Sequence[str] = ()
) -> tuple[WatchdogState, Verdict]:
    """The next state and whether the modules allow motion; `readings` names every required one."""
    faults = [*further_faults, *(fault for module, reading in readings.items() if (fault := fault_of(module, reading)))]
    if not readings:
        faults = ["no module is required, so none can be sound"]
    starting = not state.ever_granted and now_s - state.started_s < STARTUP_GRACE_S
    if faults:
        return WatchdogState(state.started_s, None, state.ever_granted), Verdict(False, ", ".join(faults), starting)
    since_s = now_s if state.sound_since_s is None else state.sound_since_s
    if now_s - since_s < WATCHDOG_CLEAR_S:
        waiting = Verdict(False, "all modules are there, watching them for a moment", starting)
        return WatchdogState(state.started_s, since_s, state.ever_granted), waiting
    return WatchdogState(state.started_s, since_s, ever_granted=True), Verdict(True, "")
