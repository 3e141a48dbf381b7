"""The table of modules: which there are, what the specification calls them, where each runs and what starts it.

Everything else that lists modules is derived from here: topics of status and log (`messages`), roles of certificates
(`access`), addresses (`zenoh_session`), the processes of the local mesh, the table of the command center.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Board(Enum):
    MEGA = "Arduino Mega"
    BEAGLEBONE = "BeagleBone Black"
    RASPBERRY = "Raspberry Pi"
    LAPTOP = "laptop"


@dataclass(frozen=True, slots=True)
class Module:
    name: str  # first part of its topics
    code: str  # the specification's name of it, as a sender of messages in the text form
    title: str  # for people
    board: Board
    package: str = ""  # started as `python -m package`; empty for firmware, for which the bridge publishes
    optional: bool = False  # runs only where somebody names it: in robot.toml, or on the command line of `local`


# In the order of the data. bridge, recorder and ros are not in the specification: the first two send as SIM and as CM
MODULES = (
    Module("sim", "SIM", "Sensors", Board.MEGA),
    Module("car", "CAR", "Carrier", Board.MEGA),
    Module("bridge", "SIM", "Serial bridge", Board.BEAGLEBONE, "onboard.bridge"),
    Module("mmu", "MMU", "Mapping unit", Board.BEAGLEBONE, "onboard.mmu"),
    Module("planner", "PLN", "Planner", Board.BEAGLEBONE, "onboard.planner"),
    Module("poi", "POI", "Door camera", Board.RASPBERRY, "onboard.poi"),
    Module("comm", "CM", "Communication", Board.BEAGLEBONE, "onboard.comm"),
    Module("recorder", "CM", "Recorder", Board.LAPTOP, "offboard.recorder"),
    Module("visualizer", "VSL", "Live map", Board.LAPTOP, "offboard.visualizer"),
    Module("command_center", "CC", "Command center", Board.LAPTOP, "offboard.command_center"),
    Module("ros", "ROS", "ROS 2", Board.LAPTOP, "offboard.ros", optional=True),
)
_BEYOND_SPECIFICATION = ("bridge", "recorder", "ros")
COMMANDER = "command_center"  # who publishes what a person orders
SPECIFIED = tuple(module for module in MODULES if module.name not in _BEYOND_SPECIFICATION)
CODES = {module.name: module.code for module in MODULES}
PACKAGES = {module.name: module.package for module in MODULES if module.package}
OPTIONAL = frozenset(module.name for module in MODULES if module.optional)


def publisher_of(module: str) -> str:
    """Whose process publishes a module's topics: the bridge's for the firmware's, else its own."""
    return module if module in PACKAGES else "bridge"


def on(*boards: Board) -> tuple[str, ...]:
    """Names of the modules of some boards."""
    return tuple(module.name for module in MODULES if module.board in boards)


OFFBOARD = on(Board.LAPTOP)
ROBOT_SENDERS = on(Board.MEGA, Board.BEAGLEBONE, Board.RASPBERRY)
ON_ROBOT = tuple(name for name in ROBOT_SENDERS if name in PACKAGES)  # processes; the bridge publishes for the Mega
