"""The Command Center in the terminal of `local`: a process of its own, so that neither holds the other up.

While it runs the terminal is its own: `local` prints nothing. Its exit code decides whether the mesh ends too.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from enum import Enum

from deploy.local.process_table import PROCESSES

END_TIMEOUT_S = 5.0
_KEEP_CODE = 3


class Left(Enum):
    """How the screen was left."""

    END = "the mesh shall end"
    KEEP = "the mesh shall go on"
    FAILED = "the screen ended by itself"


def has_terminal() -> bool:
    """Keyboard and screen are a person's; Textual paints on stderr."""
    return all(stream.isatty() for stream in (sys.stdin, sys.stdout, sys.stderr))


class TerminalUi:
    """The running screen. `left` is how it was left, None while it runs; `close` in `finally`."""

    def __init__(self, arguments: Sequence[str]) -> None:
        module = PROCESSES["command_center"]
        command = [sys.executable, "-m", module, "--parent", str(os.getpid()), "--owns-mesh", *arguments]
        # In this process's own group: a terminal is read by the group in front alone
        self._process = subprocess.Popen(command)

    def left(self) -> Left | None:
        """None while it runs."""
        code = self._process.poll()
        if code is None:
            return None
        return {0: Left.END, _KEEP_CODE: Left.KEEP}.get(code, Left.FAILED)

    def close(self) -> None:
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)
            try:
                self._process.wait(END_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
