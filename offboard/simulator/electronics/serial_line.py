"""The wire between the board's UART and the bridge: SERIAL_BAUD, with the bit errors and stalls of a profile.

`SerialLine` is the wire; the world steps it. `HostPort` is its end at the bridge inside the same program;
`pty_port.PtyPort` gives that end to another process.
"""

from __future__ import annotations

from math import inf, log
from random import Random

from common.constants import SERIAL_BAUD
from offboard.simulator.electronics.board import Board
from offboard.simulator.error_profiles import ErrorProfile

BITS_PER_BYTE = 10  # 8N1
_BUFFER_BYTES = 4096  # what a USB serial driver keeps for a late reader; older bytes are lost


class SerialLine:
    """Carries bytes in both directions at the baud rate; the world calls `exchange` once per step of `step_s`."""

    def __init__(self, profile: ErrorProfile, rng: Random, step_s: float) -> None:
        self._profile, self._rng = profile, rng
        self._to_board = _Wire(profile.serial_bit_error_rate, rng, step_s)
        self._to_host = _Wire(profile.serial_bit_error_rate, rng, step_s)
        self._arrived = bytearray()
        self._stalled_until_s = 0.0
        self._next_stall_s = self._stall_spacing_s()

    def exchange(self, board: Board, now_s: float) -> None:
        """Moves what the wire carries in one step that ends at `now_s`."""
        self._to_host.put(board.serial_read())
        if now_s >= self._next_stall_s:
            self._stalled_until_s = now_s + self._profile.serial_stall_s
            self._next_stall_s = now_s + self._stall_spacing_s()
        if now_s < self._stalled_until_s:
            return
        data = self._to_board.carry()
        if data:
            board.serial_write(data)
        self._arrived += self._to_host.carry()
        if len(self._arrived) > _BUFFER_BYTES:
            del self._arrived[:-_BUFFER_BYTES]

    def send(self, data: bytes) -> None:
        """Bytes that the host sends to the board."""
        self._to_board.put(data)

    @property
    def idle(self) -> bool:
        """Nothing is on its way, and nothing will happen until a byte is: steps may pass without `exchange`."""
        return self._to_board.idle and self._to_host.idle and self._next_stall_s == inf

    @property
    def readable(self) -> bool:
        """Something has reached the host."""
        return bool(self._arrived)

    def receive(self) -> bytes:
        """Every byte that has reached the host."""
        data = bytes(self._arrived)
        self._arrived.clear()
        return data

    def _stall_spacing_s(self) -> float:
        spacing_s = self._profile.serial_stall_spacing_s
        return inf if spacing_s == inf else self._rng.expovariate(1.0 / spacing_s)


class _Wire:
    """One direction."""

    def __init__(self, bit_error_rate: float, rng: Random, step_s: float) -> None:
        self._bytes_per_step = SERIAL_BAUD / BITS_PER_BYTE * step_s
        self._waiting = bytearray()
        self._credit_bytes = 0.0
        self._rng = rng
        self._error_log = log(1.0 - bit_error_rate) if bit_error_rate > 0.0 else 0.0
        self._bits_to_error = self._draw()

    @property
    def idle(self) -> bool:
        return not self._waiting and self._credit_bytes == 0.0

    def put(self, data: bytes) -> None:
        self._waiting += data

    def carry(self) -> bytes:
        if not self._waiting:
            self._credit_bytes = 0.0  # time that the wire was idle is not made up for
            return b""
        self._credit_bytes += self._bytes_per_step
        count = min(int(self._credit_bytes), len(self._waiting))
        self._credit_bytes -= count
        data = self._waiting[:count]
        del self._waiting[:count]
        self._bits_to_error -= 8 * count
        while self._bits_to_error < 0:
            position = 8 * count + self._bits_to_error
            data[position // 8] ^= 1 << position % 8
            self._bits_to_error += 1 + self._draw()
        return bytes(data)

    def _draw(self) -> int:
        """Good bits before the next bad one (a geometric distribution)."""
        if self._error_log == 0.0:
            return 1 << 62
        return int(log(1.0 - self._rng.random()) / self._error_log)


class HostPort:
    """The bridge's end of a line in the same program: `read` and `write` never block."""

    def __init__(self, line: SerialLine) -> None:
        self._line = line

    @property
    def readable(self) -> bool:
        return self._line.readable

    def read(self) -> bytes:
        return self._line.receive()

    def write(self, data: bytes) -> None:
        self._line.send(data)

    def fileno(self) -> int | None:
        """No descriptor of the system: `readable` is to be looked at instead."""
        return -1
