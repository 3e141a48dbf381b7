"""Small floors, and the whole robot on them in lockstep: world, firmware, bridge, mapping unit, planner, comm."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from common.bus import UNFIT
from common.errors import StartError
from offboard.simulator.run.lockstep import Lockstep, build
from offboard.simulator.run.options import RunOptions
from offboard.simulator.run.side_workers import SideWorkers
from offboard.simulator.stopwatch import Stopwatch
from tests.mission.story import Story

Ring = list[list[float]]


def floor_file(folder: Path, name: str, exterior: Ring, holes: list[Ring], start: tuple[float, float]) -> Path:
    """A floor of bare walls; the robot starts along x."""
    path = folder / f"{name}.json"
    content = {
        "name": name,
        "units": "m",
        "wall_colour_rgb": [230, 225, 210],
        "corridor": {"exterior": exterior, "holes": holes},
        "doors": [],
        "posters": [],
        "starts": [{"x_m": start[0], "y_m": start[1], "heading_deg": 0}],
    }
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def box(x0: float, y0: float, x1: float, y1: float) -> Ring:
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]


@pytest.fixture(scope="session")
def island(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A hall 1.8 m wide round an island."""
    folder = tmp_path_factory.mktemp("floors")
    return floor_file(folder, "island", box(0, 0, 8, 6), [box(1.8, 1.8, 6.2, 4.2)], (3.0, 0.9))


@pytest.fixture(scope="session")
def hall(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A hall that is closed at both ends."""
    return floor_file(tmp_path_factory.mktemp("floors"), "hall", box(0, 0, 10, 1.6), [], (1.0, 0.8))


@pytest.fixture(scope="session")
def hall_with_door(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with a door, its plate and a poster on its south wall."""
    path = floor_file(tmp_path_factory.mktemp("floors"), "hall with door", box(0, 0, 10, 1.6), [], (1.0, 0.8))
    content = json.loads(path.read_text(encoding="utf-8"))
    on_wall = {"y_m": 0.0, "normal_deg": 90.0, "centre_height_m": 1.5}
    plate = on_wall | {"x_m": 3.2, "on_door": False, "width_m": 0.2, "height_m": 0.15, "style": "light on dark"}
    content["doors"] = [
        {
            "x_m": 4.0,
            "y_m": 0.0,
            "normal_deg": 90.0,
            "width_m": 0.9,
            "height_m": 2.1,
            "colour_rgb": [70, 96, 130],
            "number": "215B",
            "room_type": "Office",
            "plate": plate | {"number_height_m": 0.04},
        }
    ]
    content["posters"] = [on_wall | {"x_m": 6.0, "width_m": 0.42, "height_m": 0.59, "text": "Open day 2019"}]
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


@pytest.fixture(autouse=True)
def nothing_unfit_is_said(caplog: pytest.LogCaptureFixture) -> Iterator[None]:
    """What a node says of itself stays within the bounds of the message table."""
    yield
    assert [text for text in caplog.messages if UNFIT in text] == []


@pytest.fixture
def tell() -> Iterator[Callable[..., Story]]:
    """`tell(floor, seed=1, events=...)` powers a robot on; `beside` makes what works beside its nodes."""
    robots: list[Lockstep] = []

    def power_on(floor: Path, beside: Callable[[Stopwatch], SideWorkers] | None = None, **options: Any) -> Story:
        stopwatch = Stopwatch()
        workers = None if beside is None else beside(stopwatch)
        try:
            robots.append(build(RunOptions(floor, **options), beside=workers, stopwatch=stopwatch))
        except StartError as error:
            pytest.skip(str(error))
        return Story(robots[-1])

    yield power_on
    for robot in robots:
        robot.close()
