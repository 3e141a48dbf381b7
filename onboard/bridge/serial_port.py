"""The serial port as the bridge sees it, and its pyserial form: the only place that knows pyserial."""

from __future__ import annotations

import contextlib
import os
from typing import Protocol

import serial


class SerialLost(ConnectionError):
    """The port is not there, or not any more; the message is one sentence with what to do."""


class Port(Protocol):
    """No call blocks; `read` and `write` raise SerialLost when the port is gone."""

    def read(self) -> bytes:
        """Everything that has arrived."""

    def write(self, data: bytes) -> None: ...

    def fileno(self) -> int | None:
        """The descriptor to wait on for bytes; None once it is closed."""


_WRITE_TIMEOUT_S = 0.2  # shorter than the firmware waits for a heartbeat; a busy machine may need some of it


class SerialPort:
    """A tty by its path. Opening it restarts most Arduinos; the board sends HELLO afterwards."""

    def __init__(self, path: str, baud: int) -> None:
        self._path = path
        try:
            self._serial = serial.Serial(path, baud, timeout=0, write_timeout=_WRITE_TIMEOUT_S, exclusive=True)
        except (serial.SerialException, OSError, ValueError) as error:
            raise SerialLost(_sentence(path, error)) from error

    def read(self) -> bytes:
        try:
            count = self._serial.in_waiting  # fails where the device is gone, while a read would find nothing
            return os.read(self._serial.fileno(), count) if count else b""
        except (serial.SerialException, OSError, TypeError) as error:
            # TypeError: pyserial raises it when the device goes away between two of its calls
            self.close()
            raise SerialLost(_sentence(self._path, error)) from error

    def write(self, data: bytes) -> None:
        try:
            self._serial.write(data)
        except (serial.SerialException, OSError, TypeError) as error:
            self.close()
            raise SerialLost(_sentence(self._path, error)) from error

    def fileno(self) -> int | None:
        return self._serial.fd if self._serial.is_open else None

    def close(self) -> None:
        with contextlib.suppress(serial.SerialException, OSError):
            self._serial.close()


def _sentence(path: str, error: Exception) -> str:
    reason = str(error).lower()
    if "permission" in reason:
        return f"{path} may not be opened: add this user to the group dialout and log in again"
    if "no such file" in reason or "not found" in reason:
        return f"{path} is not there: plug in the Arduino, or set bridge.serial_port in robot.toml"
    if "busy" in reason or "exclusively lock" in reason or "unavailable" in reason:
        return f"{path} is in use by another program: close it"
    return f"{path} cannot be used ({error}): check the USB cable"
