"""A board in the simulated building with all its errors, driven over the line by hand."""

from __future__ import annotations

from collections.abc import Callable
from math import degrees
from typing import Any

from common.messages.motion import Speed
from deploy.boards.board_link import BoardLink
from offboard.simulator.building.floor import parse_floor
from offboard.simulator.electronics.board import Board
from offboard.simulator.electronics.serial_line import HostPort, SerialLine
from offboard.simulator.error_profiles import PROFILES, ErrorProfile, random_stream
from offboard.simulator.physics.world import STEP_S, World
from onboard.bridge.protocol import Message


def open_hall(length_m: float, width_m: float) -> Any:
    return hall([(0, 0), (length_m, 0), (length_m, width_m), (0, width_m)], (2.0, width_m / 2))


def hall(outline_m: list[tuple[float, float]], start_m: tuple[float, float]) -> Any:
    """A floor of that outline, counter-clockwise; the robot starts along x."""
    content: dict[str, Any] = {
        "name": "hall",
        "units": "m",
        "wall_colour_rgb": [230, 230, 230],
        "corridor": {"exterior": [list(corner_m) for corner_m in outline_m], "holes": []},
        "doors": [],
        "posters": [],
        "starts": [{"x_m": start_m[0], "y_m": start_m[1], "heading_deg": 0.0}],
    }
    return parse_floor(content, "hall")


class Course:
    """Every time is simulated time since power-on."""

    def __init__(
        self,
        board: Board,
        seed: int,
        errors: str | ErrorProfile = "realistic",
        *,
        floor: Any = None,
    ) -> None:
        profile = PROFILES[errors] if isinstance(errors, str) else errors
        line = SerialLine(profile, random_stream(seed, "serial"), STEP_S)
        self.world = World(floor or open_hall(20, 6), 0, seed, profile, board, line)
        self.link = BoardLink(HostPort(line))
        self.messages: list[Message] = []

    @property
    def now_s(self) -> float:
        return self.world.time_s

    @property
    def heading_deg(self) -> float:
        return degrees(self.world.truth.heading_rad)

    def step(self) -> None:
        self.world.step()
        self.messages += self.link.step(self.now_s)

    def until(self, holds: Callable[[], bool], within_s: float) -> None:
        end_s = self.now_s + within_s
        while not holds():
            assert self.now_s < end_s, f"not within {within_s} s: {self.link.car}"
            self.step()

    def at(self, time_s: float) -> None:
        while self.now_s < time_s - 1e-9:
            self.step()

    def get_ready(self) -> None:
        self.link.allow_motion()
        self.until(lambda: self.link.ready, 6.0)

    def turn(self, yaw_deg: float) -> None:
        command = self.link.drive(Speed.STOP, yaw_deg)
        self.until(lambda: self.link.completed(command), 15.0)
