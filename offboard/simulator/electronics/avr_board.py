"""The Arduino as the simulated world holds it, with the very binary that is flashed: in simavr, pin by pin.

The same interface as `HostBoard`, several hundred times slower. simavr is under the GPL, so what links it stands apart
in `arduino/simavr/`; only `simulate --board avr` loads it.
"""

from __future__ import annotations

import ctypes
import fcntl
import shutil
import subprocess
from functools import cache
from pathlib import Path

from offboard.simulator.electronics.board import (
    ROOT,
    SKETCH,
    TX_BYTES,
    FirmwareBuildError,
    NativeBoard,
    ResetCause,
    bind_board,
    compile_library,
)

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
    arguments = [*FLAGS, str(GLUE), "-lsimavr", "-lelf"]
    return compile_library(LIBRARY, inputs, arguments, "the link to simavr does not compile")


class _Outputs(ctypes.Structure):
    pwm_left: int
    pwm_right: int
    enabled: int
    fired: int
    resets: int
    latency: int
    cycles: int
    asleep: int
    interrupts: int
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
        ("interrupts", ctypes.c_uint64),
        ("tx_length", ctypes.c_uint32),
        ("tx", ctypes.c_char * TX_BYTES),
    )


@cache
def _library() -> ctypes.CDLL:
    library = ctypes.CDLL(str(_build_glue()))
    pointer, number = ctypes.c_void_p, ctypes.c_int
    bind_board(library, "avr_board", _Outputs)
    library.avr_board_new.argtypes, library.avr_board_new.restype = [ctypes.c_char_p, ctypes.c_char_p], pointer
    library.avr_board_reset.argtypes, library.avr_board_reset.restype = [pointer, number], None
    library.avr_board_imu_hang.argtypes, library.avr_board_imu_hang.restype = [pointer], None
    library.avr_board_untouched.argtypes, library.avr_board_untouched.restype = [pointer], number
    return library


class AvrBoard(NativeBoard):
    """An ATmega2560 with the firmware in its flash."""

    def __init__(self, *, elf: Path | None = None, bootloader: Path | None = None) -> None:
        """`elf`: a test build; `bootloader`: a hex file to start from. Raises FirmwareBuildError."""
        elf = elf or build_avr_firmware()
        super().__init__(_library(), "avr_board")
        hex_name = str(bootloader).encode() if bootloader is not None else b""
        board = _library().avr_board_new(str(elf).encode(), hex_name)
        if board is None:
            raise FirmwareBuildError(f"{elf} cannot be loaded into simavr: build it anew (make -C arduino clean all)")
        self._hold(board)
        self.reset()

    def reset(self, cause: ResetCause = ResetCause.POWER_ON) -> None:
        self._left = self._right = 0
        self._push_inputs()
        _library().avr_board_reset(self._board, _MCUSR[cause])

    def imu_hang(self) -> None:
        """The next transfer to the MPU-6050 never ends by itself."""
        _library().avr_board_imu_hang(self._board)

    @property
    def watchdog_resets(self) -> int:
        return int(self._out.resets)

    @property
    def busy_share(self) -> float:
        """Share of its time that the processor was not asleep, since power-on."""
        return float(1.0 - self._out.asleep / max(self._out.cycles, 1))

    @property
    def interrupt_share(self) -> float:
        """Share of its time spent in interrupts, since power-on."""
        return float(self._out.interrupts / max(self._out.cycles, 1))

    @property
    def worst_interrupt_latency_us(self) -> float:
        """From an interrupt's cause to its first instruction."""
        return float(self._out.latency / 16.0)

    @property
    def untouched_ram(self) -> int:
        """Bytes that neither variables nor stack have ever used since power-on."""
        return int(_library().avr_board_untouched(self._board))
