"""`robot.toml` -> one frozen, typed configuration; an unknown key or a wrong type is an error, never ignored.

Every process reads the same file. What the file leaves out takes the value written here; physical numbers come from
`constants`. A further section is a further dataclass here and a field of `Config`.
"""

from __future__ import annotations

import dataclasses
import re
import tomllib
from dataclasses import dataclass, field
from math import degrees, pi, radians
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

from common.constants import (
    CAMERA_FIELD_OF_VIEW_RAD,
    ENCODER_TICKS_PER_TURN,
    PLANNER_CLEARANCE_M,
    SONAR_BEARINGS_RAD,
    SONAR_COUNT,
    WHEEL_DIAMETER_M,
    WHEEL_TRACK_M,
)
from common.errors import StartError
from common.messages import STATUS


class ConfigError(StartError):
    """The configuration cannot be used: one sentence with file, key and what is expected."""


@dataclass(frozen=True, slots=True)
class RobotSection:
    name: str = "robot1"  # first part of every key on the bus


@dataclass(frozen=True, slots=True)
class MeshSection:
    """Who meets where. One file may serve all machines: each process takes of it what is for its own."""

    # Where comm listens, and the modules beside it connect; they listen at the same port of 127.0.0.2 and so on
    router: str = "tcp/127.0.0.1:7447"
    laptop_router: str = "tcp/127.0.0.1:7448"  # where the recorder listens, the laptop's own router
    listen: str = ""  # where comm listens for the other machines, e.g. "tls/0.0.0.0:7449"; empty: for none
    robot: str = ""  # where the other machines find comm, e.g. "tls/robot:7449"; empty: all is on this machine
    keys: str = ""  # folder that `deploy keys` made; empty: everybody on this machine may command


@dataclass(frozen=True, slots=True)
class BridgeSection:
    serial_port: str = "/dev/ttyACM0"  # better: the board's own name below /dev/serial/by-id
    baud: int = 115200


@dataclass(frozen=True, slots=True)
class WheelsSection:
    """Calibrated body: what `WHEEL_DIAMETER_M` and `WHEEL_TRACK_M` are on this very robot."""

    diameter_m: float = WHEEL_DIAMETER_M
    track_m: float = WHEEL_TRACK_M

    @property
    def tick_m(self) -> float:
        """What a wheel rolls in one tick of its encoder."""
        return pi * self.diameter_m / ENCODER_TICKS_PER_TURN


@dataclass(frozen=True, slots=True)
class SonarsSection:
    """Where the five sonars look, in the order of `SONAR_NAMES`; degrees for people, left positive."""

    bearings_deg: tuple[float, ...] = tuple(round(degrees(b), 6) for b in SONAR_BEARINGS_RAD)

    @property
    def bearings_rad(self) -> tuple[float, ...]:
        return tuple(radians(b) for b in self.bearings_deg)


@dataclass(frozen=True, slots=True)
class CommSection:
    required: tuple[str, ...] = ("bridge", "mmu", "planner")  # on-robot modules without which nothing moves
    stop_when_offboard_missing: bool = False
    outbox_limit_mb: int = 512  # what waits for the recorder on the robot's disk; above it status and log thin out


@dataclass(frozen=True, slots=True)
class PlannerSection:
    clearance_m: float = PLANNER_CLEARANCE_M  # kept between hull and wall


@dataclass(frozen=True, slots=True)
class VisualizerSection:
    host: str = "127.0.0.1"  # where the page is served; "0.0.0.0" shows it to the whole network
    port: int = 8080  # 0: any free one
    names: tuple[str, ...] = ()  # by which browsers find this machine, besides its own, e.g. "laptop.example.org"


@dataclass(frozen=True, slots=True)
class PoiSection:
    """The camera, and what signs look like at this site."""

    source: str = "picamera"  # or /dev/video0, a number, a photo or folder of photos, unix:PATH
    field_of_view_deg: float = round(degrees(CAMERA_FIELD_OF_VIEW_RAD), 6)  # from side to side
    number_pattern: str = "[0-9]{3,4}[A-Z]?"  # a whole room number: capitals, without spaces and dashes
    room_types: tuple[str, ...] = (
        "Office", "Meeting Room", "Conference Room", "Laboratory", "Lab", "Classroom", "Lecture Room", "Seminar Room",
        "Washroom", "Restroom", "Toilet", "WC", "Storage", "Kitchen", "Library", "Reception", "Server Room",
        "Copy Room", "Printer Room", "Mail Room", "Lounge", "Workshop", "Studio", "Staff Room", "Utility", "Stairs",
    )  # fmt: skip
    door_colours: tuple[str, ...] = ()  # from `calibrate doors`; without, a door is what stands out from the wall


@dataclass(frozen=True, slots=True)
class Config:
    robot: RobotSection = field(default_factory=RobotSection)
    mesh: MeshSection = field(default_factory=MeshSection)
    bridge: BridgeSection = field(default_factory=BridgeSection)
    wheels: WheelsSection = field(default_factory=WheelsSection)
    sonars: SonarsSection = field(default_factory=SonarsSection)
    comm: CommSection = field(default_factory=CommSection)
    planner: PlannerSection = field(default_factory=PlannerSection)
    visualizer: VisualizerSection = field(default_factory=VisualizerSection)
    poi: PoiSection = field(default_factory=PoiSection)

    @property
    def has_camera(self) -> bool:
        """Does the robot look for points of interest?"""
        return "poi" in self.comm.required


def with_camera(config: Config) -> Config:
    """The configuration of a robot that has a camera: without the POI module nothing moves either."""
    required = tuple(dict.fromkeys((*config.comm.required, "poi")))
    return dataclasses.replace(config, comm=dataclasses.replace(config.comm, required=required))


_NAMES = {str: "text in quotes", int: "a whole number", float: "a number", bool: "true or false"}


def _convert(value: Any, hint: Any, where: str) -> Any:
    if get_origin(hint) is tuple:
        element = get_args(hint)[0]
        if not isinstance(value, list):
            raise ConfigError(f"{where} must be a list of {_NAMES[element]}.")
        return tuple(_convert(v, element, f"{where}[{i}]") for i, v in enumerate(value))
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(value) is not hint:
        raise ConfigError(f"{where} must be {_NAMES[hint]}, not {value!r}.")
    return value


def _section(kind: type[Any], table: Any, where: str) -> Any:
    if not isinstance(table, dict):
        raise ConfigError(f"{where} must be a section, written [{where.split()[-1]}].")
    hints = get_type_hints(kind)
    known = [f.name for f in dataclasses.fields(kind)]
    for key in table:
        if key not in known:
            raise ConfigError(f"{where}.{key} is not known; the keys there are {', '.join(known)}.")
    return kind(**{key: _convert(value, hints[key], f"{where}.{key}") for key, value in table.items()})


def _check(config: Config, file: str) -> None:
    """What a type cannot say."""
    name = config.robot.name
    if not name or any(c in "/*$#?@ " for c in name):
        raise ConfigError(f"{file}: robot.name must be one word without / * $ # ? @, not {name!r}.")
    for key, endpoint in (("listen", config.mesh.listen), ("robot", config.mesh.robot)):
        if endpoint and re.fullmatch(r"tls/\S+:\d+", endpoint) is None:
            raise ConfigError(
                f'{file}: mesh.{key} leaves this machine, so it must be "tls/HOST:PORT", not {endpoint!r}.'
            )
        if endpoint and not config.mesh.keys:
            raise ConfigError(
                f"{file}: mesh.{key} needs mesh.keys, the folder that `indoor-mapping deploy keys` makes."
            )
    for module in config.comm.required:
        if module not in STATUS:
            raise ConfigError(f"{file}: comm.required names {module!r}; the modules are {', '.join(STATUS)}.")
    for key, length_m in (("diameter_m", config.wheels.diameter_m), ("track_m", config.wheels.track_m)):
        if not 0.01 < length_m < 2.0:
            raise ConfigError(f"{file}: wheels.{key} must be between 0.01 and 2 metres, not {length_m}.")
    if not 0 <= config.visualizer.port <= 65535:
        raise ConfigError(f"{file}: visualizer.port must be between 0 and 65535, not {config.visualizer.port}.")
    for host in config.visualizer.names:
        if re.fullmatch(r"[A-Za-z0-9.-]+", host) is None:
            raise ConfigError(f"{file}: visualizer.names must hold names of this machine, not {host!r}.")
    view_deg = config.poi.field_of_view_deg
    if not 10.0 < view_deg < 170.0:
        raise ConfigError(f"{file}: poi.field_of_view_deg must be between 10 and 170, not {view_deg}.")
    count = len(config.sonars.bearings_deg)
    if count != SONAR_COUNT:
        raise ConfigError(f"{file}: sonars.bearings_deg must hold {SONAR_COUNT} angles, not {count}.")


def parse_config(text: str, file: str = "robot.toml") -> Config:
    """The configuration in `text`; raises ConfigError, `file` being the name it speaks of."""
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{file} is no valid TOML: {error}.") from error
    hints = get_type_hints(Config)
    for name in tables:
        if name not in hints:
            raise ConfigError(f"{file}: section [{name}] is not known; the sections are {', '.join(hints)}.")
    sections = {name: _section(hints[name], table, f"{file}: {name}") for name, table in tables.items()}
    config = Config(**sections)
    _check(config, file)
    return config


def load_config(path: Path | None) -> Config:
    """The configuration in a file, or all defaults for None; raises ConfigError."""
    if path is None:
        return Config()
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no text"
        raise ConfigError(f"The configuration {path} cannot be read: {reason}.") from error
    return parse_config(text, str(path))


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple):
        return "[" + ", ".join(_toml(v) for v in value) + "]"
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return repr(value)


def config_text(config: Config) -> str:
    """The configuration as `robot.toml` holds it: `parse_config` reads it back to the same values."""
    lines: list[str] = []
    for section in dataclasses.fields(config):
        values = getattr(config, section.name)
        lines.append(f"[{section.name}]")
        lines.extend(f"{f.name} = {_toml(getattr(values, f.name))}" for f in dataclasses.fields(values))
        lines.append("")
    return "\n".join(lines)
