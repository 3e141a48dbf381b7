"""How a person or a supervisor ends a program in order."""

from __future__ import annotations

import signal
import threading


def end_on_signals(stop: threading.Event) -> None:
    """SIGTERM and Ctrl-C set `stop` from now on, and do nothing else. For the main thread."""
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
