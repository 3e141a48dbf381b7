"""The simulated building and the robot's body in it, connected to the firmware at its hardware layer.

Reads the board's outputs, moves the body in MuJoCo, writes the signals of encoders, IMU, sonars and bumper to the
board, then runs the firmware: one `step()` is 5 ms. The true pose stays here: no module of the robot gets it.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, radians, sin
from typing import Any, Protocol

import mujoco
import numpy as np

from common.constants import FOOTPRINT_RADIUS_M
from common.geometry import FloatArray, Pose2, wrap_angle
from offboard.simulator.building.events import Events
from offboard.simulator.building.floor import Floor, FloorError
from offboard.simulator.building.polygons import distances_m
from offboard.simulator.electronics.board import Board, ResetCause
from offboard.simulator.error_profiles import ErrorProfile, draw_run_errors, random_stream
from offboard.simulator.physics.body import Body
from offboard.simulator.physics.drive_train import DriveTrain
from offboard.simulator.physics.mujoco_model import Scenery, build_model
from offboard.simulator.sensors.imu import Imu
from offboard.simulator.sensors.sonar import Circle, EchoModel, SonarBank
from offboard.simulator.stopwatch import FIRMWARE, PHYSICS, SONARS, Stopwatch

STEP_S = 0.005
_STEP_US = 5000
_IMU_STEPS = 2
_TRUTH_STEPS = 20
_PEOPLE_STEPS = 4
_BUMPER_HALF_ANGLE_RAD = radians(60.0)
_UNMEASURED_MAX = 500
_FAR_BELOW_M = -10.0  # where an absent person is kept


class Line(Protocol):
    """A serial line that carries bytes between the board's UART and the bridge."""

    @property
    def idle(self) -> bool:
        """Until the board sends something `exchange` changes nothing."""

    def exchange(self, board: Board, now_s: float) -> None:
        """Moves the bytes of one step, in both directions."""


class World:
    """One run: a floor, a start, a seed, and the board that drives."""

    def __init__(
        self,
        floor: Floor,
        start_index: int,
        seed: int,
        profile: ErrorProfile,
        board: Board,
        line: Line | None = None,
        events: Events | None = None,
        scenery: Scenery | None = None,
        stopwatch: Stopwatch | None = None,
    ) -> None:
        """`start_index` counts from 0; `scenery` is what a camera sees (`scenery.build_scenery`), None without one.

        Raises FloorError when the floor has no such start.
        """
        if not 0 <= start_index < len(floor.starts):
            raise FloorError(
                f"floor {floor.name} has no start {start_index}, choose one from 0 to {len(floor.starts) - 1}"
            )
        self.floor, self.seed, self.board = floor, seed, board
        self._line, self._events, self._scenery = line, events or Events(), scenery or Scenery()
        self.stopwatch = stopwatch or Stopwatch()
        errors = draw_run_errors(profile, seed)
        self.errors = errors
        start = floor.starts[start_index]
        self._imu = Imu(errors, random_stream(seed, "gyro"), _IMU_STEPS * STEP_S, start.heading_rad)
        drive_train = DriveTrain(errors, random_stream(seed, "slip"), STEP_S)
        self._body = Body(drive_train, self._imu, board, _STEP_US, _IMU_STEPS)
        self._sonars = SonarBank(profile, random_stream(seed, "sonar"))
        self._steps = 0
        self.people: list[Circle] = []
        self._changes_s = self._events.change_times_s()
        self._bumper = self._stop_button = False
        self.contacts = 0
        self.truth_log: list[tuple[float, float, float, float]] = []  # t_s, x_m, y_m, heading_rad at 10 Hz
        self._clearance_m = float("inf")
        self._unmeasured: list[tuple[float, float]] = []  # where it was since that was measured
        self._rebuild(0.0, (start.x_m, start.y_m, start.heading_rad), (0.0, 0.0, 0.0))
        self._write_inputs()
        self._record_truth()

    @property
    def time_s(self) -> float:
        """Time since power-on."""
        return self._steps * STEP_S

    @property
    def truth(self) -> Pose2:
        """The true pose of the robot in the floor's frame."""
        x_m, y_m, heading_rad = self._qpos.tolist()
        return Pose2(x_m, y_m, wrap_angle(heading_rad))

    @property
    def true_motion(self) -> tuple[float, float]:
        """True speed along the heading (m/s) and yaw rate (rad/s): what blurs a picture."""
        heading_rad = float(self._qpos[2])
        vx_m_s, vy_m_s, yaw_rate_rad_s = self._qvel.tolist()
        return cos(heading_rad) * vx_m_s + sin(heading_rad) * vy_m_s, yaw_rate_rad_s

    @property
    def clearance_m(self) -> float:
        """The smallest distance between footprint and wall so far; below zero the footprint was pressed into one."""
        self._measure_clearance()
        return self._clearance_m

    @property
    def walls(self) -> FloatArray:
        """(N, 4) segments as they stand now."""
        return self._walls

    def step(self) -> None:
        """5 ms of world and firmware."""
        self.run(1)

    def run(self, count: int) -> int:
        """Up to `count` steps, fewer where bytes are on their way or something else happens; returns how many."""
        self.stopwatch.enter(PHYSICS)
        begins_s = (self._steps + 1) * STEP_S
        if self._changes_s and self._changes_s[0] <= begins_s:
            self._changes_s = [t for t in self._changes_s if t > begins_s]
            self._rebuild(begins_s, self._qpos.tolist(), self._qvel.tolist())
        if self._events.people and (self._steps + 1) % _PEOPLE_STEPS == 0:
            self._move_people(begins_s)
        turn_rad_s = self._events.hand_turn_rate_rad_s(begins_s) if self._events.turns else 0.0
        done = self._body.run(min(count, self._undisturbed_steps()), self._bumper, turn_rad_s)
        self._steps += done
        state = self._body.state
        if state.touched or self._bumper:
            self._touch()
            self._body.run_board()
        if self._steps % _TRUTH_STEPS == 0:
            self._record_truth()
            self._drain_battery()
        fired = self.board.fired()
        if fired:
            self.stopwatch.enter(SONARS)
            self._ping(fired)
        if self._line is not None:
            self.stopwatch.enter(FIRMWARE)
            self._line.exchange(self.board, self.time_s)
        return done

    def _undisturbed_steps(self) -> int:
        """So many can be made in one go, as far as time and line decide."""
        if self._events.turns or (self._line is not None and not self._line.idle):
            return 1
        steps = _TRUTH_STEPS - self._steps % _TRUTH_STEPS
        if self._events.people:
            steps = min(steps, _PEOPLE_STEPS - (self._steps + 1) % _PEOPLE_STEPS)
        changes = self._changes_s and self._changes_s[0] <= (self._steps + steps) * STEP_S
        return 1 if changes else steps

    def book_time(self) -> None:
        """Sees to it that the accounts of the stopwatch are right."""
        self._body.book(self.stopwatch)

    def reset_board(self, cause: ResetCause = ResetCause.POWER_ON) -> None:
        """The board restarts here and now: its clock begins at 0, and echoes that have not arrived yet are lost."""
        self.board.reset(cause)
        self._body.board_restarted()
        self._write_inputs()

    def push_stop_button(self) -> None:
        """Pushes the stop button: it latches, or unlatches."""
        self._stop_button = not self._stop_button
        self.board.stop_button(self._stop_button)

    def _write_inputs(self) -> None:
        self._battery_mv = self._events.battery.millivolts(self.time_s)
        self.board.battery(self._battery_mv)
        self.board.bumper(self._bumper)
        self.board.cliff(False, False)
        self.board.stop_button(self._stop_button)
        vx_m_s, vy_m_s, _ = self._qvel.tolist()
        self.board.imu(*self._imu.sample(float(self._qpos[2]), vx_m_s, vy_m_s))

    def _drain_battery(self) -> None:
        """An empty one leaves the board without power: it never gets beyond its start."""
        if self.time_s >= self._events.battery.empty_s:
            self.reset_board()
        battery_mv = self._events.battery.millivolts(self.time_s)
        if battery_mv != self._battery_mv:
            self._battery_mv = battery_mv
            self.board.battery(battery_mv)

    def _rebuild(self, time_s: float, pose: Sequence[float], velocity: Sequence[float]) -> None:
        """Builds the model of the walls of this moment; the body keeps its state."""
        self._measure_clearance()
        self._walls = self._events.walls_at(self.floor, time_s)
        self.echo_model = EchoModel(self._walls)
        people = [(f"person{i}", person.radius_m) for i, person in enumerate(self._events.people)]
        self.model: Any = build_model(
            self._walls,
            self.floor.wall_colour_rgb,
            people,
            self._scenery,
            self._events.open_doors(time_s),
            STEP_S,
        )
        self.data: Any = mujoco.MjData(self.model)
        self._qpos, self._qvel = self.data.qpos, self.data.qvel
        self._qpos[:] = pose
        self._qvel[:] = velocity
        mujoco.mj_forward(self.model, self.data)
        self._body.set_model(self.model, self.data)
        self._move_people(time_s)

    def _move_people(self, time_s: float) -> None:
        self.people = []
        for i, person in enumerate(self._events.people):
            at = person.position(time_s)
            if at is None:
                self.data.mocap_pos[i] = (0.0, 0.0, _FAR_BELOW_M)
            else:
                self.data.mocap_pos[i] = (*at, 0.0)
                self.people.append((*at, person.radius_m))

    def _touch(self) -> None:
        """Presses the bumper, a bow over the front of the robot, by the contacts of this step."""
        x_m, y_m, heading_rad = self._qpos.tolist()
        pressed = False
        for contact in self.data.contact[: self.data.ncon]:
            bearing_rad = atan2(contact.pos[1] - y_m, contact.pos[0] - x_m) - heading_rad
            pressed |= abs(wrap_angle(bearing_rad)) < _BUMPER_HALF_ANGLE_RAD
        if pressed != self._bumper:
            self._bumper = pressed
            self.contacts += pressed
            self.board.bumper(pressed)
        self._unmeasured.append((x_m, y_m))

    def _ping(self, fired: Sequence[int]) -> None:
        for sonar, width_us in self._sonars.ping(self.echo_model, self._qpos.tolist(), fired, self.people):
            self.board.echo(sonar, width_us)

    def _record_truth(self) -> None:
        pose = self.truth
        self.truth_log.append((self.time_s, pose.x_m, pose.y_m, pose.heading_rad))
        self._unmeasured.append((pose.x_m, pose.y_m))
        if len(self._unmeasured) >= _UNMEASURED_MAX:
            self._measure_clearance()

    def _measure_clearance(self) -> None:
        if self._unmeasured:
            at = np.array(self._unmeasured)
            clear_m = float(distances_m(self._walls, at[:, :1], at[:, 1:]).min()) - FOOTPRINT_RADIUS_M
            self._clearance_m = min(self._clearance_m, clear_m)
            self._unmeasured.clear()
