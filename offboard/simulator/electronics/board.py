"""The Arduino in the simulated world: its pins and its clock, with the real firmware core of `arduino/` inside.

Simulated world -> `Board` (edges, echoes, IMU counts, switches) -> serial line -> bridge; motor outputs come back.
`HostBoard` runs the core as compiled by this machine's g++; a twin that runs the AVR binary has the same interface.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import Any, Protocol

from common.constants import SONAR_COUNT

ROOT = Path(__file__).resolve().parents[3]
SKETCH = ROOT / "arduino" / "indoor_mapping"
HOST = ROOT / "arduino" / "host"
LIBRARY = ROOT / "build" / "libfirmware.so"
FLAGS = ("-O2", "-Wall", "-Wextra", "-Werror", "-std=c++11", "-fPIC", "-shared")

TX_BYTES = 65536
_FIRED_BY_MASK = tuple(tuple(i for i in range(SONAR_COUNT) if mask >> i & 1) for mask in range(1 << SONAR_COUNT))


class FirmwareBuildError(RuntimeError):
    """The firmware cannot be built on this machine; the message names what to install."""


class ResetCause(IntEnum):
    """Why the microcontroller restarted; the numbers are those of the firmware."""

    POWER_ON = 0
    EXTERNAL = 1
    BROWN_OUT = 2
    WATCHDOG = 3


class Board(Protocol):
    """A microcontroller on its own clock of microseconds since power-on."""

    def run(self, until_us: int) -> None:
        """Advance the firmware to that absolute time."""

    def serial_write(self, data: bytes) -> None:
        """Bytes that the board's UART receives."""

    def serial_read(self) -> bytes:
        """Every byte that the board's UART has sent since the last call."""

    def encoder_edges(self, left: int, right: int) -> None:
        """Signed quadrature edges since the last call, forward positive."""

    def echo(self, sonar: int, width_us: int) -> None:
        """The pulse of sonar 0..4 (order of `SONAR_NAMES`), from now on; 37500 = no echo, 0 = no pulse."""

    def imu(self, ax: int, ay: int, az: int, gx: int, gy: int, gz: int) -> None:
        """What the MPU-6050 reads from now on: +-2 g, +-500 deg/s (65.5 counts per deg/s)."""

    def bumper(self, pressed: bool) -> None: ...

    def cliff(self, left: bool, right: bool) -> None:
        """True where the cliff sensor of that side sees no floor."""

    def battery(self, mv: int) -> None:
        """The battery's voltage in millivolts."""

    def stop_button(self, pressed: bool) -> None: ...

    def fired(self) -> tuple[int, ...]:
        """Sonars triggered since the last call."""

    def outputs(self) -> tuple[int, int, bool]:
        """PWM left and right (-255..255) and whether the motor driver is enabled."""

    def reset(self, cause: ResetCause = ResetCause.POWER_ON) -> None:
        """Start the firmware anew, its clock at 0."""


def compile_library(library: Path, inputs: Sequence[Path], arguments: Sequence[str], complaint: str) -> Path:
    """A shared library by g++, built again when an input is newer than it.

    Returns its path; raises FirmwareBuildError, whose message begins with `complaint`.
    """
    if library.exists() and library.stat().st_mtime > max(path.stat().st_mtime for path in inputs):
        return library
    compiler = shutil.which("g++")
    if compiler is None:
        raise FirmwareBuildError("g++ is needed to build the firmware for the simulation: install it (apt install g++)")
    library.parent.mkdir(exist_ok=True)
    handle, temporary = tempfile.mkstemp(suffix=".so", dir=library.parent)
    os.close(handle)
    try:
        command = [compiler, "-o", temporary, *arguments]
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        if result.returncode:
            raise FirmwareBuildError(f"{complaint}:\n{result.stderr.strip()}")
        # In one step: several processes may build at the same time
        os.replace(temporary, library)
    finally:
        Path(temporary).unlink(missing_ok=True)
    return library


def build_firmware() -> Path:
    """The shared library of the firmware core, compiled again when a source is newer. Raises FirmwareBuildError."""
    sources = [*sorted((SKETCH / "src" / "core").glob("*.cpp")), HOST / "host_board.cpp"]
    inputs = sources + sorted((SKETCH / "src").rglob("*.h")) + sorted(HOST.glob("*.h"))
    arguments = [*FLAGS, *map(str, sources)]
    return compile_library(LIBRARY, inputs, arguments, "the firmware does not compile for this machine")


def bind_board(library: ctypes.CDLL, prefix: str, outputs: type[ctypes.Structure]) -> None:
    """Declares to ctypes the functions that every board's library has, named `<prefix>_...`."""
    pointer, number = ctypes.c_void_p, ctypes.c_int
    signatures: dict[str, tuple[list[Any], Any]] = {
        "free": ([pointer], None),
        "outputs": ([pointer], ctypes.POINTER(outputs)),
        "run": ([pointer, ctypes.c_uint64, number, number], None),
        "imu": ([pointer, *[number] * 6], None),
        "imu_unplug": ([pointer], None),
        "echo": ([pointer, number, number], None),
        "inputs": ([pointer, *[number] * 5], None),
        "serial_write": ([pointer, ctypes.c_char_p, number], None),
    }
    for name, (arguments, result) in signatures.items():
        function = getattr(library, f"{prefix}_{name}")
        function.argtypes, function.restype = arguments, result


class NativeBoard:
    """What the boards have in common: a firmware behind the C functions of `bind_board`. `_board` is its handle."""

    def __init__(self, library: ctypes.CDLL, prefix: str) -> None:
        self._board: int | None = None
        self._call: dict[str, Any] = {
            name: getattr(library, f"{prefix}_{name}")
            for name in ("free", "outputs", "imu_unplug", "echo", "inputs", "serial_write")
        }
        self._run = getattr(library, f"{prefix}_run")
        self._imu = getattr(library, f"{prefix}_imu")
        self._inputs = [0, 0, 0, 0, 12000]  # bumper, cliff left and right, stop button, battery in mV
        self._left = self._right = 0

    def __del__(self) -> None:
        if getattr(self, "_board", None) is not None:
            self._call["free"](self._board)

    def _hold(self, board: int) -> None:
        """Uses this firmware, a handle of the library, from now on."""
        self._board = board
        self._out: Any = self._call["outputs"](board).contents
        self._tx_address = ctypes.addressof(self._out) + type(self._out).tx.offset

    def addresses(self) -> dict[str, int | None]:
        """Of handle and functions, and of what the firmware puts out: for a caller in C (`native/body.h`)."""
        outputs, tx_length = ctypes.addressof(self._out), type(self._out).tx_length.offset
        functions = {"run": self._run, "imu": self._imu}
        calls = {name: ctypes.cast(function, ctypes.c_void_p).value for name, function in functions.items()}
        return {"board": self._board, **calls, "outputs": outputs, "tx_length": outputs + tx_length}

    def run(self, until_us: int) -> None:
        self._run(self._board, until_us, self._left, self._right)
        self._left = self._right = 0

    def serial_write(self, data: bytes) -> None:
        if data:
            self._call["serial_write"](self._board, data, len(data))

    def serial_read(self) -> bytes:
        length = self._out.tx_length
        if not length:
            return b""
        self._out.tx_length = 0
        return ctypes.string_at(self._tx_address, length)

    def encoder_edges(self, left: int, right: int) -> None:
        self._left += left
        self._right += right

    def echo(self, sonar: int, width_us: int) -> None:
        if not 0 <= sonar < SONAR_COUNT:
            raise ValueError(f"there is no sonar {sonar}; they are numbered 0 to {SONAR_COUNT - 1}")
        self._call["echo"](self._board, sonar, width_us)

    def imu(self, ax: int, ay: int, az: int, gx: int, gy: int, gz: int) -> None:
        self._imu(self._board, ax, ay, az, gx, gy, gz)

    def imu_unplug(self) -> None:
        """The MPU-6050 stops answering; the next call of `imu` brings it back in its state after power-on."""
        self._call["imu_unplug"](self._board)

    def bumper(self, pressed: bool) -> None:
        self._set(0, pressed)

    def cliff(self, left: bool, right: bool) -> None:
        self._set(1, left)
        self._set(2, right)

    def stop_button(self, pressed: bool) -> None:
        self._set(3, pressed)

    def battery(self, mv: int) -> None:
        self._set(4, mv)

    def _set(self, which: int, value: int) -> None:
        if self._inputs[which] != value:
            self._inputs[which] = int(value)
            self._push_inputs()

    def _push_inputs(self) -> None:
        self._call["inputs"](self._board, *self._inputs)

    def fired(self) -> tuple[int, ...]:
        mask = self._out.fired
        if not mask:
            return ()
        self._out.fired = 0
        return _FIRED_BY_MASK[mask]

    def outputs(self) -> tuple[int, int, bool]:
        out = self._out
        return out.pwm_left, out.pwm_right, bool(out.enabled)


class _Outputs(ctypes.Structure):
    pwm_left: int
    pwm_right: int
    enabled: int
    fired: int
    tx_length: int
    _fields_ = (
        ("pwm_left", ctypes.c_int32),
        ("pwm_right", ctypes.c_int32),
        ("enabled", ctypes.c_int32),
        ("fired", ctypes.c_uint32),
        ("tx_length", ctypes.c_uint32),
        ("tx", ctypes.c_char * TX_BYTES),
    )


@cache
def _library() -> ctypes.CDLL:
    library = ctypes.CDLL(str(build_firmware()))
    number = ctypes.c_int
    bind_board(library, "fw", _Outputs)
    library.fw_new.argtypes, library.fw_new.restype = [number, number, number], ctypes.c_void_p
    library.fw_stop_kept.argtypes, library.fw_stop_kept.restype = [ctypes.c_void_p], number
    library.fw_next_state.argtypes, library.fw_next_state.restype = [number, number], number
    return library


def next_safety_state(state: int, conditions: int) -> int:
    """The firmware's safety state machine alone: `CarState` and the bits of safety.h -> `CarState`."""
    result: int = _library().fw_next_state(state, conditions)
    return result


class HostBoard(NativeBoard):
    """The firmware core compiled for this machine; one step of 5 ms costs a few microseconds."""

    def __init__(self) -> None:
        super().__init__(_library(), "fw")
        self._session = 0
        self.reset()

    def reset(self, cause: ResetCause = ResetCause.POWER_ON) -> None:
        stopped = 0
        if self._board is not None:
            stopped = _library().fw_stop_kept(self._board)
            self._call["free"](self._board)
        self._session = (self._session + 1) % 65536
        self._hold(_library().fw_new(int(cause), self._session, stopped))
        self._left = self._right = 0
        self._push_inputs()
