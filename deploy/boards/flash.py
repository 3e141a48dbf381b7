"""The firmware onto the Mega by avrdude, through its bootloader, from the machine that its USB cable leads to.

Port, Intel HEX file -> whether it was written. What the Mega holds is read back first: one that has this very firmware
is left alone. Nothing else may have the port, and the robot must stand.
"""

from __future__ import annotations

import shlex
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from common.errors import StartError
from common.plain_text import plain
from deploy.boards.ssh import BoardError, Connection, Output
from onboard.bridge.serial_port import SerialLost, SerialPort

TIMEOUT_S = 100.0  # avrdude 7.1 was seen to go on for ever without its port
# The Mega's bootloader speaks STK500v2 and cannot erase the chip (-D)
_AVRDUDE = ("timeout", f"{TIMEOUT_S:g}", "avrdude", "-q", "-p", "atmega2560", "-c", "wiring", "-D")
_OTHER_CONTENT = "verification mismatch"
_NOT_FOUND = 127
_BAUD = 115200
_ON_BOARD = "/run/indoor-mapping.hex"
_REASON_MAX = 200


@dataclass(frozen=True, slots=True)
class Ran:
    """How a program ended: exit code, and what it wrote on both of its outputs."""

    code: int
    output: str


Run = Callable[[Sequence[str]], Ran]


def flash_here(port: str, firmware: Path, report: Output) -> bool:
    """The Mega's cable leads to this machine. False: it had this firmware already. Raises StartError."""
    try:
        SerialPort(port, _BAUD).close()
    except SerialLost as error:
        raise StartError(f"{error}.") from error
    return flash(_run_here, port, str(firmware), report)


def flash_on(connection: Connection, bridge: str, port: str, firmware: Path) -> bool:
    """The Mega's cable leads to a board; `bridge`: the unit that has the port, which stands still meanwhile."""
    ran = connection.run(f"systemctl is-active -q {bridge} && echo yes || true").strip()
    connection.run(f"cat > {_ON_BOARD}", firmware.read_bytes())
    connection.run(f"systemctl stop {bridge}")
    try:
        return flash(lambda words: _run_on(connection, words), port, _ON_BOARD, connection.report)
    finally:
        connection.run(f"rm -f {_ON_BOARD}{f'; systemctl start {bridge}' if ran else ''}")


def flash(run: Run, port: str, firmware: str, report: Output) -> bool:
    """`run` executes where the cable leads to. False: the Mega had this firmware already.

    Raises StartError; then the Mega may be without a firmware, and can be flashed again.
    """
    if run(("test", "-e", port)).code != 0:
        raise StartError(f"{port} is not there: plug in the Mega, or set bridge.serial_port in robot.toml.")
    if _holds(run, port, firmware):
        return False
    report("writing the firmware; leave the cable alone ...")
    written = _avrdude(run, port, "w", firmware)
    if written.code != 0:
        raise _failure(port, written)
    return True


def _holds(run: Run, port: str, firmware: str) -> bool:
    verified = _avrdude(run, port, "v", firmware)
    if verified.code != 0 and _OTHER_CONTENT not in verified.output:
        raise _failure(port, verified)
    return verified.code == 0


def _avrdude(run: Run, port: str, operation: str, firmware: str) -> Ran:
    return run((*_AVRDUDE, "-b", str(_BAUD), "-P", port, "-U", f"flash:{operation}:{firmware}:i"))


def _run_here(words: Sequence[str]) -> Ran:
    done = subprocess.run(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False, errors="replace")
    return Ran(done.returncode, done.stdout)


def _run_on(connection: Connection, words: Sequence[str]) -> Ran:
    """Through a shell of the board, which waits for it even when the link breaks."""
    output = connection.run(f'output=$({shlex.join(words)} 2>&1); echo $?; echo "$output"', timeout_s=2 * TIMEOUT_S)
    code, _, rest = output.partition("\n")
    if not code.isdigit():
        raise BoardError(f"{connection.board}: its shell answers {plain(code, _REASON_MAX)!r}.")
    return Ran(int(code), rest)


def _failure(port: str, ran: Ran) -> StartError:
    if ran.code == _NOT_FOUND:
        return StartError("avrdude is missing where the Mega's cable leads to: apt install avrdude.")
    reasons = [line.partition("error: ")[2] for line in ran.output.splitlines() if "avrdude error: " in line]
    reason = plain("; ".join(dict.fromkeys(filter(None, reasons))), _REASON_MAX) or f"avrdude ended with {ran.code}"
    return StartError(
        f"The Mega at {port} was not flashed ({reason}): check its cable, and that no other program has the port."
    )
