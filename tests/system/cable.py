"""The cable between a bridge and the board, in between a run's two ends: it can be cut and mended."""

from __future__ import annotations

import os
import pty
import select
import threading
import tty
from contextlib import suppress
from pathlib import Path

_READ_BYTES = 4096


class Cable:
    """From the device behind `port`, a symbolic link, to a device of its own, to which `port` leads from now on.

    Who has the port open keeps the old one; who opens it anew is on this cable, and what it carries while it is not
    `whole` is lost.
    """

    def __init__(self, port: Path) -> None:
        self.whole = True
        self._board = os.open(port.readlink(), os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        # The device is kept open here too: a bridge that comes and goes must not hang up the line
        self._bridge, self._device = pty.openpty()
        tty.setraw(self._device)
        os.set_blocking(self._bridge, False)
        self._woken, self._wake = os.pipe()
        new = port.with_name("cable")
        new.symlink_to(os.ttyname(self._device))
        new.replace(port)
        self._thread = threading.Thread(target=self._carry, daemon=True)
        self._thread.start()

    def _carry(self) -> None:
        other = {self._board: self._bridge, self._bridge: self._board}
        while True:
            readable, _, _ = select.select([*other, self._woken], [], [])
            if self._woken in readable:
                return
            for end in readable:
                with suppress(BlockingIOError):
                    data = os.read(end, _READ_BYTES)
                    if self.whole:
                        os.write(other[end], data)

    def close(self) -> None:
        os.write(self._wake, b"x")
        self._thread.join()
        for end in (self._board, self._bridge, self._device, self._woken, self._wake):
            os.close(end)
