"""The Arduino as the simulated world holds it, with the very binary that is flashed: in simavr, pin by pin.

The same interface as `HostBoard`, several hundred times slower. simavr is under the GPL, so what links it stands apart
in `arduino/simavr/`; a simulation loads it only when it is asked for (`simulate --board avr`).
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

from common.constants import SONAR_COUNT
from offboard.simulator.board import ROOT, SKETCH, FirmwareBuildError, ResetCause

ARDUINO = ROOT / "arduino"
GLUE = ARDUINO / "simavr" / "avr_board.cpp"
LIBRARY = ROOT / "build" / "libavrboard.so"
ELF = ROOT / "build" / "avr" / "indoor_mapping.elf"
CORE = Path("/usr/share/arduino/hardware/arduino/avr")
BOOTLOADER = CORE / "bootloaders" / "stk500v2" / "stk500boot_v2_mega2560.hex"
SIMAVR_HEADERS = Path("/usr/include/simavr")
DEBIAN_PACKAGES = ("gcc-avr", "avr-libc", "arduino-core-avr", "libsimavr-dev", "libelf-dev", "make", "g++")
INSTALL = f"apt install {' '.join(DEBIAN_PACKAGES)}"
FLAGS = ("-O2", "-Wall", "-Wextra", "-Werror", "-std=c++17", "-fPIC", "-shared", f"-I{SIMAVR_HEADERS}")

_TX_BYTES = 65536
_MCUSR = {ResetCause.POWER_ON: 1, ResetCause.EXTERNAL: 2, ResetCause.BROWN_OUT: 4, ResetCause.WATCHDOG: 8}


def missing_tools() -> bool:
    """Is anything absent that the firmware for the Mega and its simulation are built with?"""
    tools = all(shutil.which(tool) for tool in ("avr-gcc", "avr-g++", "make", "g++"))
    return not (tools and CORE.is_dir() and SIMAVR_HEADERS.is_dir())


def build_avr_firmware(name: str = "indoor_mapping", defines: str = "") -> Path:
    """The binary for the Mega, made anew when a source is newer; raises FirmwareBuildError.

    `defines` makes a test build, which then needs a `name` of its own.
    """
    if missing_tools():
        raise FirmwareBuildError(f"the firmware's build for the Mega needs tools that are not here: {INSTALL}")
    ELF.parent.mkdir(parents=True, exist_ok=True)
    command = ["make", "-s", "-C", str(ARDUINO), f"NAME={name}", f"DEFS={defines}"]
    with (ELF.parent / "lock").open("w") as lock:  # several processes may build at the same time
        fcntl.flock(lock, fcntl.LOCK_EX)
        result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode:
        raise FirmwareBuildError(f"the firmware does not compile for the Mega:\n{result.stderr.strip()}")
    return ELF.with_name(f"{name}.elf")


def _build_glue() -> Path:
    inputs = (GLUE, SKETCH / "src" / "config.h")
    if LIBRARY.exists() and LIBRARY.stat().st_mtime > max(path.stat().st_mtime for path in inputs):
        return LIBRARY
    LIBRARY.parent.mkdir(exist_ok=True)
    handle, temporary = tempfile.mkstemp(suffix=".so", dir=LIBRARY.parent)
    os.close(handle)
    try:
        command = ["g++", *FLAGS, "-o", temporary, str(GLUE), "-lsimavr", "-lelf"]
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        if result.returncode:
            raise FirmwareBuildError(f"the link to simavr does not compile:\n{result.stderr.strip()}")
        os.replace(temporary, LIBRARY)
    finally:
        Path(temporary).unlink(missing_ok=True)
    return LIBRARY


class _Outputs(ctypes.Structure):
    pwm_left: int
    pwm_right: int
    enabled: int
    fired: int
    resets: int
    latency: int
    cycles: int
    asleep: int
    tx_length: int
    _fields_ = (
        ("pwm_left", ctypes.c_int32),
        ("pwm_right", ctypes.c_int32),
        ("enabled", ctypes.c_int32),
        ("fired", ctypes.c_uint32),
        ("resets", ctypes.c_uint32),
        ("latency", ctypes.c_uint32),
        ("cycles", ctypes.c_uint64),
        ("asleep", ctypes.c_uint64),
        ("tx_length", ctypes.c_uint32),
        ("tx", ctypes.c_char * _TX_BYTES),
    )


@cache
def _library() -> ctypes.CDLL:
    library = ctypes.CDLL(str(_build_glue()))
    pointer, number = ctypes.c_void_p, ctypes.c_int
    library.avr_board_new.argtypes, library.avr_board_new.restype = [ctypes.c_char_p, ctypes.c_char_p], pointer
    library.avr_board_free.argtypes, library.avr_board_free.restype = [pointer], None
    library.avr_board_outputs.argtypes = [pointer]
    library.avr_board_outputs.restype = ctypes.POINTER(_Outputs)
    library.avr_board_reset.argtypes, library.avr_board_reset.restype = [pointer, number], None
    library.avr_board_run.argtypes = [pointer, ctypes.c_uint64, number, number]
    library.avr_board_run.restype = None
    library.avr_board_alive.argtypes, library.avr_board_alive.restype = [pointer], number
    library.avr_board_imu.argtypes, library.avr_board_imu.restype = [pointer, *[number] * 6], None
    library.avr_board_imu_unplug.argtypes, library.avr_board_imu_unplug.restype = [pointer], None
    library.avr_board_echo.argtypes, library.avr_board_echo.restype = [pointer, number, number], None
    library.avr_board_inputs.argtypes, library.avr_board_inputs.restype = [pointer, *[number] * 5], None
    library.avr_board_serial_write.argtypes = [pointer, ctypes.c_char_p, number]
    library.avr_board_serial_write.restype = None
    library.avr_board_untouched.argtypes, library.avr_board_untouched.restype = [pointer], number
    return library


_TX_OFFSET: int = _Outputs.tx.offset


class AvrBoard:
    """An ATmega2560 with the firmware in its flash."""

    def __init__(self, *, elf: Path | None = None, bootloader: Path | None = None) -> None:
        """`elf`: a test build; `bootloader`: a hex file to start from. Raises FirmwareBuildError."""
        elf = elf or build_avr_firmware()
        self._avr = _library()
        self._run = self._avr.avr_board_run
        self._imu = self._avr.avr_board_imu
        hex_name = str(bootloader).encode() if bootloader is not None else b""
        self._board: int | None = self._avr.avr_board_new(str(elf).encode(), hex_name)
        if self._board is None:
            raise FirmwareBuildError(f"{elf} cannot be loaded into simavr: build it anew (make -C arduino clean all)")
        self._out: _Outputs = self._avr.avr_board_outputs(self._board).contents
        self._tx_address = ctypes.addressof(self._out) + _TX_OFFSET
        self._inputs = [0, 0, 0, 0, 12000]  # bumper, cliff left and right, stop button, battery in mV
        self._left = self._right = 0
        self.reset()

    def __del__(self) -> None:
        if getattr(self, "_board", None) is not None:
            self._avr.avr_board_free(self._board)

    def reset(self, cause: ResetCause = ResetCause.POWER_ON) -> None:
        self._left = self._right = 0
        self._avr.avr_board_inputs(self._board, *self._inputs)
        self._avr.avr_board_reset(self._board, _MCUSR[cause])

    def run(self, until_us: int) -> None:
        self._run(self._board, until_us, self._left, self._right)
        self._left = self._right = 0

    def serial_write(self, data: bytes) -> None:
        if data:
            self._avr.avr_board_serial_write(self._board, data, len(data))

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
        self._avr.avr_board_echo(self._board, sonar, width_us)

    def imu(self, ax: int, ay: int, az: int, gx: int, gy: int, gz: int) -> None:
        self._imu(self._board, ax, ay, az, gx, gy, gz)

    def imu_unplug(self) -> None:
        """The MPU-6050 answers no more; with the next `imu` it is back, as after power-on."""
        self._avr.avr_board_imu_unplug(self._board)

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
            self._avr.avr_board_inputs(self._board, *self._inputs)

    def fired(self) -> tuple[int, ...]:
        mask = self._out.fired
        if not mask:
            return ()
        self._out.fired = 0
        return tuple(sonar for sonar in range(SONAR_COUNT) if mask >> sonar & 1)

    def outputs(self) -> tuple[int, int, bool]:
        out = self._out
        return out.pwm_left, out.pwm_right, bool(out.enabled)

    # --- what only this board can tell

    @property
    def watchdog_resets(self) -> int:
        return int(self._out.resets)

    @property
    def busy_share(self) -> float:
        """Share of its time that the processor was not asleep, since power-on."""
        return 1.0 - self._out.asleep / max(self._out.cycles, 1)

    @property
    def worst_interrupt_latency_us(self) -> float:
        """From an interrupt's cause to its first instruction."""
        return self._out.latency / 16.0

    @property
    def untouched_ram(self) -> int:
        """Bytes that neither variables nor stack have ever used since power-on."""
        return int(self._avr.avr_board_untouched(self._board))
