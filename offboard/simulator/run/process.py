"""Process "simulator": building, body and board, in real time or as leader of the shared clock.

Steps the world up to `now_s`; its serial port is a device file beside robot.toml. Writes `truth.tum`, on the clock that
all processes of the run share, and `motors.csv` beside its log: when the motors began and ceased to turn. It publishes
nothing: the modules must not know the true pose.

Signals act on the robot: SIGUSR1 pushes the stop button, which latches until the next one; SIGUSR2 restarts the board,
as most boards do when a program opens their port.
"""

from __future__ import annotations

import argparse
import logging
import signal
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from common.bus import Bus
from common.config import Config
from common.errors import StartError
from common.messages.topics import Topic
from common.process import argument_parser
from offboard.runs.run_folder import TRUTH_NAME, LineFile, tum_line
from offboard.simulator.camera.frame_server import FrameServer
from offboard.simulator.electronics.board import FirmwareBuildError, HostBoard, ResetCause
from offboard.simulator.run.options import RunOptions, load_world
from offboard.simulator.run.simulation import Simulation

WRITE_PERIOD_S = 5.0
MOTORS_NAME = "motors.csv"
LAG_MAX_S = 0.25  # a world that lags more skips the time instead of catching up

_log = logging.getLogger("simulator")


class MotorLog:
    """`t_s,pwm_left,pwm_right,enabled`, a line whenever a motor begins or ceases to turn or the driver is switched."""

    def __init__(self, file: Path) -> None:
        file.write_text("t_s,pwm_left,pwm_right,enabled\n", encoding="utf-8")
        self._lines = LineFile(file)
        self._was: tuple[bool, bool, bool] | None = None

    def note(self, now_s: float, pwm_left: int, pwm_right: int, enabled: bool) -> None:
        turning = (pwm_left != 0, pwm_right != 0, enabled)
        if turning != self._was:
            self._was = turning
            self._lines.append([f"{now_s:.3f},{pwm_left},{pwm_right},{int(enabled)}"])

    def close(self) -> None:
        self._lines.close()


class SimulatorNode:
    """Node "simulator": steps the world on the clock of the run and writes its files."""

    name = "simulator"
    period_s = 0.01
    wakes_on: tuple[Topic[Any], ...] = ()

    def __init__(
        self,
        simulation: Simulation,
        truth_file: Path | None,
        motor_file: Path | None = None,
        frames: FrameServer | None = None,
    ) -> None:
        self._simulation = simulation
        self._frames = frames
        self._motors = MotorLog(motor_file) if motor_file is not None else None
        self._truth = LineFile(truth_file) if truth_file is not None else None
        self._actions: deque[Callable[[], None]] = deque()
        self._write_due_s = 0.0
        self._power_on_s: float | None = None  # on the shared clock

    def between_steps(self, action: Callable[[], None]) -> None:
        """Runs `action` before the next step: a signal arrives at any moment, also in the middle of a step."""
        self._actions.append(action)

    def step(self, bus: Bus, now_s: float) -> None:
        world = self._simulation.world
        while self._actions:
            self._actions.popleft()()
        if self._power_on_s is None:
            self._power_on_s = now_s
        behind_s = now_s - self._power_on_s - world.time_s
        if behind_s > LAG_MAX_S:
            self._power_on_s += behind_s - self.period_s
            _log.warning("world=slower_than_real_time skipped_s=%.3f", behind_s)
        self._simulation.advance(now_s - self._power_on_s)
        if self._motors is not None:
            self._motors.note(now_s, *world.board.outputs())
        if self._frames is not None:
            self._frames.step(now_s)
        if world.time_s >= self._write_due_s:
            self._write_due_s = world.time_s + WRITE_PERIOD_S
            self._write()

    def close(self) -> None:
        self._write()
        for file in (self._truth, self._motors):
            if file is not None:
                file.close()
        if self._frames is not None:
            self._frames.close()
        self._simulation.close()

    def _write(self) -> None:
        log = self._simulation.world.truth_log
        if self._truth is not None and self._power_on_s is not None:
            self._truth.append([tum_line(t_s + self._power_on_s, x, y, heading) for t_s, x, y, heading in log])
        log.clear()


def simulator_parser() -> argparse.ArgumentParser:
    """Arguments of the process: those of every node, and the options of the run."""
    parser = argument_parser("simulator")
    parser.add_argument("--floor", type=Path, required=True)
    parser.add_argument("--start", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--errors", default="realistic")
    parser.add_argument("--camera", default="off")
    parser.add_argument("--frames", type=Path, help="socket on which the camera's frames are served")
    parser.add_argument("--events", type=Path)
    parser.add_argument("--run-dir", type=Path, help="where truth.tum goes")
    return parser


def make_simulator(config: Config, arguments: argparse.Namespace) -> SimulatorNode:
    """The node; its serial port appears under the name that robot.toml gives to the bridge. Raises StartError."""
    options = RunOptions(
        floor=arguments.floor,
        start=arguments.start,
        seed=arguments.seed,
        speed=arguments.speed,
        errors=arguments.errors,
        camera=arguments.camera,
        events=arguments.events,
    )
    floor, events = load_world(options)
    try:
        board = HostBoard()
    except FirmwareBuildError as error:
        raise StartError(str(error)) from error
    simulation = Simulation(
        floor,
        board,
        start_index=options.start,
        seed=options.seed,
        errors=options.errors,
        camera=options.camera,
        events=events,
        pty_link=Path(config.bridge.serial_port),
    )
    frames: FrameServer | None = None
    if simulation.camera is not None and arguments.frames is not None:
        frames = FrameServer(simulation.camera, arguments.frames)
    run_dir: Path | None = arguments.run_dir
    log_dir: Path | None = arguments.log_dir
    node = SimulatorNode(
        simulation,
        run_dir / TRUTH_NAME if run_dir is not None else None,
        log_dir / MOTORS_NAME if log_dir is not None else None,
        frames,
    )
    world = simulation.world
    signal.signal(signal.SIGUSR1, lambda *_: node.between_steps(world.push_stop_button))
    signal.signal(signal.SIGUSR2, lambda *_: node.between_steps(lambda: world.reset_board(ResetCause.EXTERNAL)))
    return node
