"""Walls with doors and plates, rendered as the simulated camera shows them, and small things to look at them with."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from offboard.simulator.building.floor import parse_floor
from offboard.simulator.electronics.board import FirmwareBuildError, HostBoard
from offboard.simulator.run.simulation import Simulation

ROOM_M = 4.0
SIDES = ("south", "east", "north", "west")
_PLACES = {
    # side: door on the wall, its normal, and the pose from which the robot looks at it squarely from 1.3 m
    "south": ((2.0, 0.0), 90.0, (2.0, 1.3, 0.0)),
    "east": ((4.0, 2.0), 180.0, (2.7, 2.0, 90.0)),
    "north": ((2.0, 4.0), -90.0, (2.0, 2.7, 180.0)),
    "west": ((0.0, 2.0), 0.0, (1.3, 2.0, -90.0)),
}


def floor_with_door(side: str, number: str = "417", room_type: str = "Office", poster: str = "") -> dict[str, Any]:
    """A room of 4 x 4 m with one door and its plate on it, or a poster instead; the start has it on the right."""
    (x, y), normal_deg, start = _PLACES[side]
    door = {
        "x_m": x,
        "y_m": y,
        "normal_deg": normal_deg,
        "width_m": 0.9,
        "height_m": 2.1,
        "colour_rgb": [150, 104, 62],
        "number": number,
        "room_type": room_type,
        "plate": {
            "x_m": x,
            "y_m": y,
            "on_door": True,
            "centre_height_m": 1.5,
            "width_m": 0.2,
            "height_m": 0.15,
            "number_height_m": 0.04,
            "style": "dark on light",
        },
    }
    posters = []
    if poster:
        posters.append(
            {
                "x_m": x,
                "y_m": y,
                "normal_deg": normal_deg,
                "width_m": 0.42,
                "height_m": 0.59,
                "centre_height_m": 1.5,
                "text": poster,
            }
        )
    return {
        "name": f"room {side}",
        "units": "m",
        "wall_colour_rgb": [230, 228, 220],
        "corridor": {"exterior": [[0, 0], [ROOM_M, 0], [ROOM_M, ROOM_M], [0, ROOM_M]], "holes": []},
        "doors": [] if poster else [door],
        "posters": posters,
        "starts": [{"x_m": start[0], "y_m": start[1], "heading_deg": start[2]}],
    }


@contextmanager
def looking_at(floor: dict[str, Any], camera: str = "realistic") -> Iterator[Simulation]:
    """The simulation of a robot that stands at the floor's start; skips the test where nothing can be drawn."""
    try:
        board = HostBoard()
    except FirmwareBuildError as error:
        pytest.skip(str(error))
    with Simulation(parse_floor(floor, "floor of a test"), board, camera=camera) as simulation:
        if simulation.camera is None:
            pytest.skip("no OpenGL library: apt install libegl1 libopengl0 libgl1-mesa-dri")
        yield simulation


def full_frame(floor: dict[str, Any], camera: str = "realistic") -> np.ndarray[Any, np.dtype[np.uint8]]:
    with looking_at(floor, camera) as simulation:
        assert simulation.camera is not None
        image = None
        while image is None:  # one in a hundred is lost
            image = simulation.camera.full()
        return image
