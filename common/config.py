"""What `robot.toml` holds: one frozen, typed configuration, a dataclass for each section (`config_file` reads it).

Every process reads the same file. What the file leaves out takes the value written here; physical numbers come from
`constants`. A further section is a further dataclass here and a field of `Config`; what a value must be besides its
type is annotated with `rules`, a number always with its limits. The text below a key is its line in
`docs/robot-toml.md`.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from math import degrees, pi, radians
from typing import Annotated, Any, cast

from common.constants import (
    CAMERA_FIELD_OF_VIEW_RAD,
    ENCODER_TICKS_PER_TURN,
    SERIAL_BAUD,
    SONAR_BEARINGS_RAD,
    SONAR_COUNT,
    WHEEL_DIAMETER_M,
    WHEEL_TRACK_M,
)
from common.modules import MODULES, OFFBOARD, OPTIONAL, PACKAGES, Board, on
from common.number_presets import PRESETS
from common.rules import Between, Count, Form, Names, OnPlate, Pattern

# Sections of the computers that run processes
BOARDS = {"beaglebone": Board.BEAGLEBONE, "raspberry": Board.RASPBERRY, "laptop": Board.LAPTOP}

_HOST = r"[A-Za-z0-9._:\[\]%-]+"
_LENGTH_M = Between(0.01, 2.0)
_TO_OTHERS = Form(rf"(tls/{_HOST}:\d{{1,5}})?", 'leaves this machine, so it must be "tls/HOST:PORT"')
_ON_LOOPBACK = Form(rf"tcp/{_HOST}:\d{{1,5}}", 'must be "tcp/HOST:PORT"')
_DOOR_COLOUR = Form(r"H\d{1,3}-\d{1,3} S\d{1,3}-\d{1,3} V\d{1,3}-\d{1,3}", "must be like 'H8-22 S60-255 V30-230'")
_REPAIR = Form(r"\S<?>\S", 'must be like "O<>0" or "Q>0"')
_SHARING = "comm|mmu|planner|poi"
_PROCESS = Form(
    rf"({_SHARING})(\+({_SHARING}))*|bridge|{'|'.join(OFFBOARD)}",
    "must be a module, or several of the robot joined by +; the bridge has a process of its own",
)
_SSH = Form(r"([A-Za-z0-9_][A-Za-z0-9_.-]*@)?[A-Za-z0-9][A-Za-z0-9._-]*|", 'must be "USER@HOST" or "HOST"')
_PLATFORM = Form("armv7l|aarch64|x86_64", 'must be "armv7l", "aarch64" or "x86_64"')
_LABEL = "[A-Za-z0-9_-]{1,63}"


@dataclass(frozen=True, slots=True)
class RobotSection:
    name: Annotated[str, Form(r"[^/*$#?@\s]{1,64}", "must be one word without / * $ # ? @")] = "robot1"
    """First part of every key on the bus."""


@dataclass(frozen=True, slots=True)
class MeshSection:
    """Who meets where. One file may serve all machines: each process takes of it what is for its own."""

    router: Annotated[str, _ON_LOOPBACK] = "tcp/127.0.0.1:7447"
    """Where comm listens and the modules beside it connect; they listen at the same port of 127.0.0.2 and so on."""
    laptop_router: Annotated[str, _ON_LOOPBACK] = "tcp/127.0.0.1:7448"
    """Where the recorder listens."""
    listen: Annotated[str, _TO_OTHERS] = ""
    """Where comm listens for the other machines, e.g. "tls/0.0.0.0:7449"; empty: for none."""
    robot: Annotated[str, _TO_OTHERS] = ""
    """Where the other machines find comm, e.g. "tls/robot:7449"; empty: all is on this machine."""
    keys: str = ""
    """Folder that `deploy keys` made; empty: everybody on this machine may command."""


@dataclass(frozen=True, slots=True)
class BoardSection:
    """A computer of the robot: which processes it runs, and how `deploy` reaches it."""

    processes: tuple[Annotated[str, _PROCESS], ...] = ()
    """What it runs; modules joined by + share one process and its links. Empty: it is not used."""
    ssh: Annotated[str, _SSH] = ""
    """Where `deploy` logs in, e.g. "debian@10.0.0.2" or a name of ~/.ssh/config; empty: `deploy` leaves it alone."""
    platform: Annotated[str, _PLATFORM] = "x86_64"
    """What `uname -m` prints there."""
    debian: Annotated[int, Between(12, 13)] = 12
    """Release of its Debian (or Raspberry Pi OS), from which its Python follows: 12 has 3.11, 13 has 3.13."""


@dataclass(frozen=True, slots=True)
class BridgeSection:
    serial_port: str = "/dev/ttyACM0"
    """Device of the Arduino; better than the default: the board's own name below /dev/serial/by-id."""
    baud: Annotated[int, Between(1, 10_000_000)] = SERIAL_BAUD
    """Bits per second; the firmware has a fixed 250000."""


@dataclass(frozen=True, slots=True)
class WheelsSection:
    """Calibrated body: what `WHEEL_DIAMETER_M` and `WHEEL_TRACK_M` are on this very robot."""

    diameter_m: Annotated[float, _LENGTH_M] = WHEEL_DIAMETER_M
    """Of both wheels; `calibrate wheels` measures it."""
    track_m: Annotated[float, _LENGTH_M] = WHEEL_TRACK_M
    """Between the wheels' points of contact; `calibrate wheels` measures it."""

    @property
    def tick_m(self) -> float:
        """What a wheel rolls in one tick of its encoder."""
        return pi * self.diameter_m / ENCODER_TICKS_PER_TURN


@dataclass(frozen=True, slots=True)
class SonarsSection:
    """Where the five sonars look, in the order of `SONAR_NAMES`; degrees for people, left positive."""

    bearings_deg: Annotated[tuple[Annotated[float, Between(-180.0, 180.0)], ...], Count(SONAR_COUNT, "angles")] = tuple(
        round(degrees(b), 6) for b in SONAR_BEARINGS_RAD
    )
    """Direction of each, counter-clockwise from straight ahead."""

    @property
    def bearings_rad(self) -> tuple[float, ...]:
        return tuple(radians(b) for b in self.bearings_deg)


@dataclass(frozen=True, slots=True)
class CommSection:
    required: Annotated[tuple[str, ...], Names(tuple(module.name for module in MODULES), "the modules")] = (
        "bridge",
        "mmu",
        "planner",
    )
    """On-robot modules without which nothing moves; with a camera also "poi"."""
    stop_when_offboard_missing: bool = False
    """Does the robot stand while the recorder on the laptop is missing?"""
    outbox_limit_mb: Annotated[int, Between(1, 1_000_000)] = 512
    """Size of what waits for the recorder on the robot's disk; above it status and log thin out."""


@dataclass(frozen=True, slots=True)
class VisualizerSection:
    host: Annotated[str, Form(rf"({_LABEL}\.)*{_LABEL}|[0-9A-Fa-f:.]*", "must be a name or an address")] = "127.0.0.1"
    """Address at which the page is served; "0.0.0.0" shows it to the whole network."""
    port: Annotated[int, Between(0, 65535)] = 8080
    """Port of the page; 0: any free one."""
    names: tuple[Annotated[str, Form("[A-Za-z0-9.-]+", "must be a name of this machine")], ...] = ()
    """Names by which browsers find this machine, besides its own, e.g. "laptop.example.org"."""


@dataclass(frozen=True, slots=True)
class RosSection:
    """The process `ros`, which runs where `processes` of the laptop names it."""

    network: bool = False
    """Meet ROS programs on other machines too? Then none of them can order anything: nothing shows who they are."""


@dataclass(frozen=True, slots=True)
class PoiSection:
    """The camera, and what signs look like at this site."""

    source: str = "picamera"
    """Where images come from: "picamera", "/dev/video0", a number, a photo or folder of photos, "unix:PATH"."""
    field_of_view_deg: Annotated[float, Between(10.0, 170.0)] = round(degrees(CAMERA_FIELD_OF_VIEW_RAD), 6)
    """Horizontal field of view; `calibrate camera` measures it."""
    number_presets: Annotated[tuple[str, ...], Names(tuple(PRESETS), "the presets")] = ()
    """Forms of the site's room numbers, e.g. ["building-room"]; without any and without `number_pattern`: ["plain"]."""
    number_pattern: Annotated[str, Pattern(longest=200), OnPlate()] = ""
    """A form of the site's own: regular expression of a whole number as it stands on the plate, with its separators."""
    number_repairs: tuple[Annotated[str, _REPAIR], ...] = (
        "O<>0", "I<>1", "S<>5", "B<>8", "Z>2", "Q>0", "D>0", "L>1", "|>1", "1>|", "I>|", "L>|", ",>.",
    )  # fmt: skip
    """What is read for one another, exchanged only where a number's form wants the other: <> both, > the first."""
    words_before: tuple[str, ...] = (
        "Room", "Rm", "Suite", "No", "Nr", "Nº", "N°", "№", "#", "Raum", "Zimmer", "Zi", "Salle", "Bureau", "Sala",
        "Aula", "Habitación", "Stanza", "Kamer", "Lokal", "Pokój",
    )  # fmt: skip
    """What may stand before a room number on its line, besides the room types."""
    words_behind: tuple[str, ...] = ()
    """What may stand behind it, besides the room types and up to three ideographs (501室)."""
    room_types: tuple[str, ...] = (
        "Office", "Meeting Room", "Conference Room", "Laboratory", "Lab", "Classroom", "Lecture Room", "Seminar Room",
        "Washroom", "Restroom", "Toilet", "WC", "Storage", "Kitchen", "Library", "Reception", "Server Room",
        "Copy Room", "Printer Room", "Mail Room", "Lounge", "Workshop", "Studio", "Staff Room", "Utility", "Stairs",
    )  # fmt: skip
    """What stands on plates below the number."""
    door_colours: tuple[Annotated[str, _DOOR_COLOUR], ...] = ()
    """HSV ranges of doors, from `calibrate doors`; without any, a door is what stands out from the wall."""


@dataclass(frozen=True, slots=True)
class Config:
    robot: RobotSection = field(default_factory=RobotSection)
    mesh: MeshSection = field(default_factory=MeshSection)
    beaglebone: BoardSection = BoardSection(("bridge", "comm+mmu+planner"), platform="armv7l")
    raspberry: BoardSection = BoardSection(("poi",), platform="aarch64")
    laptop: BoardSection = BoardSection(tuple(name for name in OFFBOARD if name not in OPTIONAL))
    bridge: BridgeSection = field(default_factory=BridgeSection)
    wheels: WheelsSection = field(default_factory=WheelsSection)
    sonars: SonarsSection = field(default_factory=SonarsSection)
    comm: CommSection = field(default_factory=CommSection)
    visualizer: VisualizerSection = field(default_factory=VisualizerSection)
    ros: RosSection = field(default_factory=RosSection)
    poi: PoiSection = field(default_factory=PoiSection)

    @property
    def boards(self) -> dict[str, BoardSection]:
        """By the names of their sections."""
        return {board: getattr(self, board) for board in BOARDS}

    @property
    def processes(self) -> tuple[str, ...]:
        """Those of all boards."""
        return tuple(process for board in self.boards.values() for process in board.processes)

    def process_of(self, module: str) -> str:
        """The process that runs a module; the module's own name where no board has it."""
        return next((process for process in self.processes if module in process.split("+")), module)

    def board_of(self, module: str) -> str:
        """The board that runs a module; raises StopIteration where none does."""
        return next(name for name, board in self.boards.items() if module in "+".join(board.processes).split("+"))

    @property
    def has_camera(self) -> bool:
        """Does the robot look for points of interest?"""
        return "poi" in self.comm.required


def apart(config: Config) -> Config:
    """The configuration with every module in a process of its own, on the computer that it is made for."""
    wanted = [m for m in PACKAGES if m not in OPTIONAL or m in config.processes]
    own = {name: tuple(m for m in on(computer) if m in wanted) for name, computer in BOARDS.items()}
    boards = {name: dataclasses.replace(board, processes=own[name]) for name, board in config.boards.items()}
    return dataclasses.replace(config, **cast(dict[str, Any], boards))


def with_process(config: Config, process: str) -> Config:
    """The configuration with another process on the laptop: an optional one, which runs only where it is named."""
    laptop = dataclasses.replace(config.laptop, processes=(*config.laptop.processes, process))
    return dataclasses.replace(config, laptop=laptop)


def with_camera(config: Config) -> Config:
    """The configuration of a robot that has a camera: without the POI module nothing moves either."""
    required = tuple(dict.fromkeys((*config.comm.required, "poi")))
    return dataclasses.replace(config, comm=dataclasses.replace(config.comm, required=required))
