"""A robot that answers as the real one does, and the Command Center's node beside it, on one clock that the test turns.

The app of the pilot tests shows the node; nothing here waits for real time.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import Any

import numpy as np
from textual.pilot import Pilot

from common.bus import LocalMesh
from common.codec import decode
from common.errors import ErrorCode
from common.messages.health import BoardState, LogLine, Status
from common.messages.mapping import MapUpdate, PoseEstimate
from common.messages.mission import OperatorCommand, PlannerView
from common.messages.motion import CarrierReport, CarrierState, Odometry
from common.messages.points_of_interest import PointOfInterest
from common.messages.stop import Permit, StopRequest
from common.messages.topics import (
    BOARD,
    CARRIER,
    LOG,
    MAP,
    ODOMETRY,
    OPERATION,
    PERMIT,
    PLAN,
    POI,
    POSE,
    STATUS,
    STOP,
    Topic,
)
from common.recording import RecordedMessage
from offboard.command_center.app import CommandCenterApp
from offboard.command_center.command_center import CommandCenter

SIZE = (150, 40)  # of a terminal: columns, rows
TICK_S = 0.05
BRAKING_S = 0.2
EPOCH_S = 1_700_000_000.0  # when the rig was switched on
SPEAKING = ("sim", "car", "bridge", "mmu", "planner", "comm", "recorder")


def piloted(test: Callable[..., Awaitable[None]]) -> Callable[..., None]:
    """Runs an asynchronous test."""

    @wraps(test)
    def run(*arguments: Any, **named: Any) -> None:
        asyncio.run(test(*arguments, **named))

    return run


class Wire(LocalMesh):
    """What arrives has been bytes: it is as the codec lets it in."""

    def deliver(self, topic: Topic[Any], payload: Any, message: RecordedMessage, *, news: bool) -> None:
        super().deliver(topic, decode(message.data, topic.payload).payload, message, news=news)


class Rig:
    """`run` lets time pass for robot and node; `silent` names modules that say nothing, `deaf` stops hear nothing."""

    def __init__(self) -> None:
        self.mesh = Wire()
        self.bus = self.mesh.endpoint("command_center")
        self.robot = self.mesh.endpoint("robot")
        self.node = CommandCenter(lambda: self.mesh.now_s, wall_clock=lambda: EPOCH_S + self.mesh.now_s)
        self.speaking: tuple[str, ...] = SPEAKING
        self.silent: set[str] = set()
        self.errors: dict[str, ErrorCode] = {}
        self.sources: set[str] = set()
        self.deaf = False
        self.moves = True
        self.words = ""  # what every module says of itself
        self.mission: dict[str, Any] = {}  # what the planner says else than that it follows a hall
        self.resumed = True  # since the newest stop
        self.stops: list[StopRequest] = []
        self.operations: list[OperatorCommand] = []
        self.epoch, self.stop_ids, self.button_pressed = 1, list[int](), False
        self._latched_s = float("inf")
        self._acknowledged = 0
        self._ticks = 0
        self.robot.take(STOP), self.robot.take(OPERATION)
        self.run(0.5)

    @property
    def now_s(self) -> float:
        return self.mesh.now_s

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / TICK_S)):
            self._ticks += 1
            self.mesh.now_s = self._ticks * TICK_S
            self._hear()
            if self._ticks % 2 == 0:
                self._report()
            self.node.step(self.bus, self.now_s)
            self.node.stop_desk.send(self.bus)

    def app(self, folder: Path, *, owns_mesh: bool = False) -> CommandCenterApp:
        return CommandCenterApp(
            self.node, robot="robot1", page="http://127.0.0.1:8080/", export_dir=folder, owns_mesh=owns_mesh
        )

    def log(self, module: str, level: str, text: str) -> None:
        self.robot.publish(LOG[module], LogLine(self.now_s, level, text))

    def report_board(self, module: str, state: BoardState) -> None:
        self.robot.publish(BOARD[module], state)

    def find_door(self, number: str, x_m: float, y_m: float) -> None:
        door = PointOfInterest(self.now_s, int(number), "Door", number, x_m, y_m, number, "OFFICE", 0.9, "read")
        self.robot.publish(POI, door)

    def draw_wall(self) -> None:
        points = np.stack([np.linspace(0, 8, 80), np.ones(80)], axis=1).astype(np.float32)
        self.robot.publish(MAP, MapUpdate(self.now_s, 1, 0, points, np.zeros(80, np.uint8)))

    def _hear(self) -> None:
        for request in self.robot.take(STOP):
            self.stops.append(request)
            if self.deaf:
                continue
            if request.latched and not self.sources:
                self._latched_s = self.now_s
            if request.latched and request.stop_id not in self.stop_ids:
                self.epoch += 1
                self.stop_ids.append(request.stop_id)
                self.sources.add(request.source)
            elif not request.latched and request.epoch == self.epoch:
                self.sources.clear(), self.stop_ids.clear()
        for command in self.robot.take(OPERATION):
            self.operations.append(command)
            if "planner" not in self.silent:
                self._acknowledged = command.command_id

    def _report(self) -> None:
        now_s, say = self.now_s, self.robot.publish
        for module in self.speaking:
            if module not in self.silent:
                error = self.errors.get(module, ErrorCode.OK)
                ready, words = error is ErrorCode.OK, self.words
                say(STATUS[module], Status(now_s, words or "RUN", int(error), 51_200, ready, self._ticks, words))
        standing = (bool(self.sources) and now_s - self._latched_s >= BRAKING_S) or not self.moves
        speed_m_s = 0.0 if standing else 0.16
        if "bridge" not in self.silent:
            say(ODOMETRY, Odometry(now_s, 0, 0, 0.0, 0.0, 0.0, 0.0, speed_m_s, standing, False, False, 1))
            report = CarrierReport(now_s, CarrierState.MOVING, 0, 0, 0, speed_m_s, 0, 0, not self.sources, False, 12.1)
            say(CARRIER, replace(report, board_epoch=self.epoch, button_pressed=self.button_pressed))
        if "comm" not in self.silent:
            sources, stop_ids = tuple(sorted(self.sources)), tuple(self.stop_ids)
            reason = self.words or (f"stopped by {', '.join(sources)}" if sources else "")
            permit = Permit(now_s, not sources and self.resumed, reason, sources, stop_epoch=self.epoch)
            say(PERMIT, replace(permit, stop_ids=stop_ids, resumed=self.resumed))
        if "mmu" not in self.silent:
            say(POSE, PoseEstimate(now_s, 3.2, -1.05, 1.57, 0.0, 0.03, 0.01, 1))
        if "planner" not in self.silent:
            way = np.array([[4.0, 0.0]], np.float32)
            does = self.words or "following the hall"
            view = PlannerView(now_s, "STRAIGHT", does, way, 3, 42.5, command_id=self._acknowledged)
            say(PLAN, replace(view, **self.mission))


async def settle(rig: Rig, app: CommandCenterApp, pilot: Pilot[int], seconds: float = 1.0) -> None:
    """Time passes, and the screen shows it."""
    rig.run(seconds)
    app.pull()
    await pilot.pause()


@asynccontextmanager
async def shown(
    rig: Rig, folder: Path, size: tuple[int, int] = SIZE
) -> AsyncIterator[tuple[CommandCenterApp, Pilot[int]]]:
    """The Command Center in a terminal of that size (columns, rows), settled."""
    app = rig.app(folder)
    async with app.run_test(size=size) as pilot:
        await settle(rig, app, pilot)
        yield app, pilot
