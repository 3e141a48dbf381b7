"""The processes that `node NAME` and the local mesh start: every module with a program, and the simulated world."""

from __future__ import annotations

from common.modules import PACKAGES

SIMULATOR = "simulator"
# Name -> what is started as `python -m package`
PROCESSES = {SIMULATOR: "offboard.simulator"} | PACKAGES
SHARED = "onboard"  # of modules that are joined by +, which follow


def program_of(process: str) -> tuple[str, ...]:
    """The words behind `python -m` for a process, as `robot.toml` names it; raises KeyError where there is none."""
    return (SHARED, process) if "+" in process else (PROCESSES[process],)


def without(process: str, modules: set[str]) -> str:
    """The process with some of its modules left out; empty when none remains."""
    return "+".join(module for module in process.split("+") if module not in modules)
