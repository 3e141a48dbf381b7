"""The robot's body in the inner loop: motors and wheels, MuJoCo, encoders and IMU, and the board that runs beside it.

A board of native code is run by the loop itself (`native/body.cpp`), several steps in one call; one that is a Python
object takes what a step gives, step by step.
"""

from __future__ import annotations

from ctypes import pointer
from typing import Any

from offboard.simulator.electronics.board import Board, NativeBoard
from offboard.simulator.native.library import BoardCalls, BodyState, library, mujoco_step
from offboard.simulator.physics.drive_train import DriveTrain
from offboard.simulator.sensors.imu import Imu
from offboard.simulator.stopwatch import FIRMWARE, IMU, PHYSICS, Stopwatch


class Body:
    """Steps model and data of MuJoCo, the ones set last."""

    def __init__(self, drive_train: DriveTrain, imu: Imu, board: Board, step_us: int, imu_steps: int) -> None:
        self._parts = drive_train, imu  # whose states are pointed at
        self._imu, self._board = imu, board
        self._library = library()
        self.state = BodyState(
            drive_train=pointer(drive_train.state),
            imu=pointer(imu.state),
            step=mujoco_step(),
            step_us=step_us,
            imu_steps=imu_steps,
        )
        self._native = isinstance(board, NativeBoard)
        self.board_restarted()

    def board_restarted(self) -> None:
        """Its clock begins at 0 now, and its library may have another handle for it."""
        self.state.power_on_us = self.state.steps * self.state.step_us
        if isinstance(self._board, NativeBoard):
            self.state.board = BoardCalls(**self._board.addresses())

    def set_model(self, model: Any, data: Any) -> None:
        self._model = model, data
        self.state.model, self.state.data = model._address, data._address

    def run(self, count: int, touching: bool, hand_turn_rad_s: float) -> int:
        """Up to `count` steps; fewer where the board did something that others must look at. Returns how many.

        Where the body touched something, or did so until now (`touching`), the board has not run the last step yet.
        """
        state = self.state
        state.touching, state.hand_turn_rad_s = touching, hand_turn_rad_s
        if self._native:
            done: int = self._library.body_run(state, count)
            return done
        state.outputs = self._board.outputs()
        self._library.body_move(state)
        if not (state.touched or touching):
            self.run_board()
        return 1

    def run_board(self) -> None:
        """The board's part of the step."""
        state, board = self.state, self._board
        if self._native:
            self._library.body_run_board(state)
            return
        board.encoder_edges(*state.edges)
        if state.sampled:
            board.imu(*self._imu.counts)
        board.run(state.steps * state.step_us - state.power_on_us)

    def book(self, stopwatch: Stopwatch) -> None:
        """What the steps since the last time spent, from one account of theirs onto each its own."""
        state = self.state
        stopwatch.move(PHYSICS, IMU, state.imu_ns * 1e-9)
        stopwatch.move(PHYSICS, FIRMWARE, state.board_ns * 1e-9)
        state.imu_ns = state.board_ns = 0
