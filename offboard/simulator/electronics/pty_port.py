"""A pseudo-terminal at the bridge's end of the serial line: a real bridge process opens a real serial port."""

from __future__ import annotations

import contextlib
import os
import pty
import tty
from pathlib import Path

from offboard.simulator.electronics.board import Board
from offboard.simulator.electronics.serial_line import SerialLine

_READ_BYTES = 4096


class PtyPort:
    """A serial line whose host end is a device file. `close` removes the link."""

    def __init__(self, line: SerialLine, link: Path | None = None) -> None:
        """`link`: a fixed name for the device, a symbolic link that replaces an older one. Raises OSError."""
        self._line, self._link = line, link
        # The simulator keeps the slave end open too: when the last slave end closes, the master end reads EIO
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.device = Path(os.ttyname(self._slave))
        if link is not None:
            link.unlink(missing_ok=True)
            link.symlink_to(self.device)

    @property
    def path(self) -> Path:
        """What the bridge opens."""
        return self._link or self.device

    @property
    def idle(self) -> bool:
        """Never known: the host may have written to the device."""
        return False

    def exchange(self, board: Board, now_s: float) -> None:
        """Like SerialLine.exchange, with the bytes of the device."""
        with contextlib.suppress(BlockingIOError):
            self._line.send(os.read(self._master, _READ_BYTES))
        self._line.exchange(board, now_s)
        data = self._line.receive()
        if data:
            # Where nobody reads the buffer is full and the bytes are lost, as on a wire without handshake
            with contextlib.suppress(BlockingIOError):
                os.write(self._master, data)

    def close(self) -> None:
        if self._link is not None and self._link.is_symlink() and self._link.readlink() == self.device:
            self._link.unlink()
        os.close(self._master)
        os.close(self._slave)
