"""The options of a simulated run, checked; `local`, `simulate` and the simulator take them."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from common.config import PoiSection
from common.config_file import load_config
from common.errors import StartError
from common.json_reader import load_json
from offboard.runs.run_folder import SETTINGS_NAME, TRAJECTORY_NAME, write_json
from offboard.simulator.building.events import Events, load_events
from offboard.simulator.building.floor import Floor, FloorError, load_floor
from offboard.simulator.error_profiles import PROFILES

FLOORS = Path(__file__).parents[1] / "floors"
DEFAULT_FLOOR = "office"
SPEED_MAX = 100.0
READING_MAX_S = 60.0
CAMERAS = ("off", "clean", "realistic", "hard")


@dataclass(frozen=True, slots=True)
class RunOptions:
    """As the verbs `local` and `simulate` take them."""

    floor: Path
    start: int = 0  # which of the floor's starts, from 0
    seed: int = 0
    speed: float = 1.0  # simulated over wall time, `local` only
    headless: bool = False
    apart: bool = False  # every module in a process of its own, `local` only
    ros: bool = False  # the optional process too, `local` only
    out: Path | None = None  # the run folder; None: a new one under runs/
    errors: str = "realistic"  # one of errors.PROFILES
    camera: str = "off"  # one of CAMERAS
    events: Path | None = None
    board: str = "host"  # or "avr", `simulate` only
    route: str | None = None  # a scripted drive, "centrelines" or "walls", `simulate` only
    reading_s: float | None = None  # what reading one photo takes, one after the other; None: 0.5 s, `simulate` only
    config: Path | None = None  # robot.toml, of which [poi] holds: what the plates of this building look like

    def as_dict(self) -> dict[str, Any]:
        """For summary.json: plain values."""
        plain = {name: getattr(self, name) for name in self.__slots__}
        return {name: str(value) if isinstance(value, Path) else value for name, value in plain.items()}


def own_floors() -> list[str]:
    """Names of the floors that come with the project."""
    return sorted(path.stem for path in FLOORS.glob("*.json"))


def floor_path(name: str) -> Path:
    """A file, or one of the project's own floors by its name; raises StartError."""
    path = Path(name)
    if path.is_file():
        return path
    own = FLOORS / f"{name}.json"
    if own.is_file():
        return own
    raise StartError(f"There is no floor file {name}; the project's own floors are {', '.join(own_floors())}.")


def load_world(options: RunOptions) -> tuple[Floor, Events]:
    """Floor and events, all of the options checked against them; raises StartError with one sentence."""
    floor = load_floor(options.floor)
    events = load_events(options.events, floor) if options.events is not None else Events()
    if not 0 <= options.start < len(floor.starts):
        raise StartError(f"Floor {floor.name} has the starts 0 to {len(floor.starts) - 1}, not {options.start}.")
    if options.errors not in PROFILES:
        raise StartError(f"There is no error profile {options.errors}; choose one of {', '.join(PROFILES)}.")
    if options.seed < 0:
        raise StartError(f"The seed must be 0 or more, not {options.seed}.")
    if not 0.0 < options.speed <= SPEED_MAX:
        raise StartError(f"The speed must be above 0 and at most {SPEED_MAX:g}, not {options.speed:g}.")
    if options.reading_s is not None and not 0.0 < options.reading_s <= READING_MAX_S:
        raise StartError(f"The reading must take above 0 and at most {READING_MAX_S:g} s, not {options.reading_s:g}.")
    site_section(options)
    return floor, events


def site_section(options: RunOptions) -> PoiSection:
    """What the robot is told of the building's plates; raises StartError."""
    return load_config(options.config).poi


def floor_json(options: RunOptions) -> dict[str, Any]:
    """The floor file as it stands, for the evaluation; raises FloorError."""
    content: dict[str, Any] = load_json(options.floor, f"floor file {options.floor}", FloorError)
    return content


def prepare_folder(options: RunOptions) -> Path:
    """The run folder, new or empty, with what the run is; raises StartError."""
    folder = options.out or Path("runs") / f"{datetime.now():%Y-%m-%d_%H-%M-%S}"
    if (folder / TRAJECTORY_NAME).exists():
        raise StartError(f"The folder {folder} holds a run already; choose another with --out, or remove it.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        settings = {"floor": options.floor.stem, "start": options.start, "seed": options.seed}
        write_json(folder / SETTINGS_NAME, settings)
    except OSError as error:
        raise StartError(f"The run folder {folder} cannot be made: {error.strerror}.") from error
    return folder
