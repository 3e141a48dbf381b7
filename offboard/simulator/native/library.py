"""The inner loop of the simulated body in C++ (`body.cpp`): its structures, and the library compiled for this machine.

`physics/drive_train.py`, `sensors/imu.py` and `physics/body.py` fill the structures and call its functions.
"""

from __future__ import annotations

import ctypes
from ctypes import CFUNCTYPE, POINTER, c_double, c_int, c_int32, c_int64, c_void_p
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import mujoco

from common.errors import StartError
from offboard.simulator.electronics.board import ROOT, FirmwareBuildError, compile_library

SOURCE = Path(__file__).parent / "body.cpp"
LIBRARY = ROOT / "build" / "libbody.so"
_PACKAGE = Path(mujoco.__file__).parent
# No contraction of a product and a sum: the same numbers on every machine
FLAGS = ("-O2", "-Wall", "-Wextra", "-Werror", "-std=c++17", "-ffp-contract=off", "-fPIC", "-shared")
_BLOCK = 1024

_Callback = CFUNCTYPE(None)


class Normals(ctypes.Structure):
    uniform: Any
    count: int
    used: int
    spare: float
    has_spare: int
    refill: Any
    _fields_ = (
        ("uniform", POINTER(c_double)),
        *((name, c_int64) for name in ("count", "used")),
        ("spare", c_double),
        ("has_spare", c_int64),
        ("refill", _Callback),
    )


class DriveTrainState(ctypes.Structure):
    speed_m_s: float
    yaw_rate_rad_s: float
    next_bump_m: float
    bump_rad_s: float
    bump_left_s: float
    normals: Normals
    _fields_ = (
        *((name, c_double) for name in ("step_s", "motor_response", "dead_zone_pwm", "speed_per_pwm_m_s")),
        *((name, c_double) for name in ("friction_m_s2", "standing_m_s", "slip_length_m")),
        *((name, c_double) for name in ("slip_sd", "track_m", "ticks_per_m")),
        ("diameter_factor", c_double * 2),
        ("bumps", c_int64),
        *((name, c_double * 2) for name in ("rim_m_s", "rolled_m", "slip")),
        *((name, c_double) for name in ("next_bump_m", "bump_rad_s", "bump_left_s")),
        ("ticks", c_int64 * 2),
        *((name, c_double) for name in ("speed_m_s", "yaw_rate_rad_s")),
        ("draw_bump", _Callback),
        ("normals", Normals),
    )


class ImuState(ctypes.Structure):
    counts: Any
    normals: Normals
    _fields_ = (
        *((name, c_double) for name in ("period_s", "scale", "walk_rad_s", "white_rad_s")),
        *((name, c_double) for name in ("accel_counts", "gyro_counts")),
        ("bias_rad_s", c_double * 3),
        ("heading_rad", c_double),
        ("velocity_m_s", c_double * 2),
        ("counts", c_int32 * 6),
        ("normals", Normals),
    )


class BoardCalls(ctypes.Structure):
    _fields_ = tuple((name, c_void_p) for name in ("board", "run", "imu", "outputs", "tx_length"))


class BodyState(ctypes.Structure):
    board: BoardCalls
    model: int
    data: int
    hand_turn_rad_s: float
    steps: int
    power_on_us: int
    outputs: Any
    touched: int
    touching: int
    edges: Any
    sampled: int
    imu_ns: int
    board_ns: int
    _fields_ = (
        ("drive_train", POINTER(DriveTrainState)),
        ("imu", POINTER(ImuState)),
        ("board", BoardCalls),
        *((name, c_void_p) for name in ("model", "data", "step")),
        ("hand_turn_rad_s", c_double),
        *((name, c_int64) for name in ("steps", "step_us", "power_on_us", "imu_steps")),
        ("outputs", c_int32 * 3),
        *((name, c_int32) for name in ("touched", "touching")),
        ("edges", c_int32 * 2),
        ("sampled", c_int32),
        *((name, c_int64) for name in ("imu_ns", "board_ns")),
    )


class NormalStream:
    """The numbers of a random stream for `normals`, a block at a time. No `gauss` of the stream is left half used."""

    def __init__(self, rng: Random, normals: Normals) -> None:
        self._rng, self._normals = rng, normals
        self._state: Any = None
        self._block: Any = None
        self._callback = callback(self._refill)
        normals.refill = self._callback

    def rewound(self) -> Random:
        """The stream after what was used: for what else is drawn from it."""
        if self._state is not None:
            self._rng.setstate(self._state)
            for _ in range(self._normals.used):
                self._rng.random()
            self._state = None
        self._normals.used = self._normals.count = 0
        return self._rng

    def _refill(self) -> None:
        random = self._rng.random
        self._state = self._rng.getstate()
        self._block = (c_double * _BLOCK)(*[random() for _ in range(_BLOCK)])
        self._normals.uniform = self._block
        self._normals.used, self._normals.count = 0, _BLOCK


def callback(function: Any) -> Any:
    """As a field of a structure takes it; to be kept as long as the structure is used."""
    return _Callback(function)


@cache
def library() -> ctypes.CDLL:
    """Compiled when it is older than its sources. Raises StartError where that cannot be done."""
    inputs = (SOURCE, SOURCE.with_suffix(".h"))
    arguments = [*FLAGS, f"-I{_PACKAGE / 'include'}", str(SOURCE)]
    try:
        made = ctypes.CDLL(str(compile_library(LIBRARY, inputs, arguments, "the simulated body does not compile")))
    except FirmwareBuildError as error:
        raise StartError(str(error)) from error
    train, imu, body = POINTER(DriveTrainState), POINTER(ImuState), POINTER(BodyState)
    signatures: dict[str, tuple[list[Any], Any]] = {
        "drive_train_step": ([train, c_int, c_int, c_int], None),
        "drive_train_edges": ([train, POINTER(c_int32)], None),
        "imu_sample": ([imu, c_double, c_double, c_double], None),
        "body_move": ([body], None),
        "body_run_board": ([body], None),
        "body_run": ([body, c_int], c_int),
    }
    for name, (types, result) in signatures.items():
        function = getattr(made, name)
        function.argtypes, function.restype = types, result
    return made


@cache
def mujoco_step() -> int:
    """Address of `mj_step`."""
    found = ctypes.CDLL(str(next(_PACKAGE.glob("libmujoco.*"))))
    address: int | None = ctypes.cast(found.mj_step, c_void_p).value
    assert address is not None
    return address
