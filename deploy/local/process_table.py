"""The processes that `node NAME` and the local mesh start: every module with a program, and the simulated world."""

from __future__ import annotations

from common.modules import PACKAGES

SIMULATOR = "simulator"
# Name -> what is started as `python -m package`
PROCESSES = {SIMULATOR: "offboard.simulator"} | PACKAGES
