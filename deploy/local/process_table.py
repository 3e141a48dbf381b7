"""Which processes there are and where they run: `node NAME`, the local mesh and the boards start them from here."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ProcessSpec:
    name: str
    module: str  # started as `python -m module`
    board: str  # beaglebone, raspberry, laptop; "" for what stands in for the world
    local: bool = True  # part of the local mesh


PROCESSES: tuple[ProcessSpec, ...] = (
    ProcessSpec("simulator", "offboard.simulator", ""),
    ProcessSpec("comm", "onboard.comm", "beaglebone"),
    ProcessSpec("bridge", "onboard.bridge", "beaglebone"),
    ProcessSpec("mmu", "onboard.mmu", "beaglebone"),
    ProcessSpec("planner", "onboard.planner", "beaglebone"),
    ProcessSpec("poi", "onboard.poi", "raspberry"),
    ProcessSpec("recorder", "offboard.recorder", "laptop"),
    ProcessSpec("visualizer", "offboard.visualizer", "laptop"),
    # It takes a terminal: `local` opens it in its own, where it has one
    ProcessSpec("command_center", "offboard.command_center", "laptop", local=False),
)
BY_NAME = {spec.name: spec for spec in PROCESSES}
