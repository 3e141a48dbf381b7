"""The services of the boards: what they do, their logs, start and stop. By systemd's own programs, over ssh."""

from __future__ import annotations

import shlex
import subprocess
import threading
from collections.abc import Iterable
from math import floor

from deploy.boards.layout import TARGET, UNIT_PREFIX
from deploy.boards.probe import Facts
from deploy.boards.ssh import Connection, Output, last_line

LINES = 200
_SYSTEMCTL_S = 300.0  # a start takes up to a minute and a half on a slow board


def start(connection: Connection) -> None:
    """All services of the board; raises BoardError."""
    connection.change(f"systemctl start {TARGET}", timeout_s=_SYSTEMCTL_S)


def stop(connection: Connection) -> None:
    """All of them: what they hold is written, and nothing moves."""
    connection.change(f"systemctl stop {TARGET} '{UNIT_PREFIX}-*.service'", timeout_s=_SYSTEMCTL_S)


def status_lines(facts: Facts) -> list[str]:
    """For a person: the board, then a line for each service."""
    heat = "" if facts.temperature_deg is None else f", {facts.temperature_deg:.0f} °C"
    permit = f", permit {facts.permit}" if facts.permit else ""
    board = (
        f"release {facts.release or 'none'}, up {_span(facts.uptime_s)}, load {facts.load}{heat}, "
        f"{facts.free_kb / 1e6:.1f} GB free, clock {facts.clock_offset_s:+.2f} s{permit}"
    )
    services = [f"  {unit}: {state}, {n} restarts" for unit, (state, n) in facts.units.items()]
    return [board, *services]


def _span(seconds: float) -> str:
    minutes = floor(seconds / 60)
    if minutes < 120:
        return f"{minutes} min"
    return f"{minutes // 60} h" if minutes < 48 * 60 else f"{minutes // 1440} days"


def show_logs(connections: Iterable[Connection], lines: int, *, follow: bool, show: Output) -> int:
    """The newest lines of the journals, each with its board; with `follow` until a person ends it."""
    words = ["journalctl", "--no-pager", "-o", "short-monotonic", "-n", str(lines), "-u", f"{UNIT_PREFIX}-*"]
    command = shlex.join([*words, "-f"] if follow else words)
    shown = [_Journal(connection, command, show) for connection in connections]
    try:
        return max(journal.wait() for journal in shown)
    finally:
        for journal in shown:
            journal.close()


class _Journal:
    """Of one board, read by a thread."""

    def __init__(self, connection: Connection, command: str, show: Output) -> None:
        self._board, self._show = connection.board, show
        self._process = subprocess.Popen(
            connection.command(command), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, errors="replace"
        )
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._show(f"{self._board}: {line.rstrip()}")

    def wait(self) -> int:
        self._thread.join()
        code = self._process.wait()
        if code > 0:
            assert self._process.stderr is not None
            self._show(f"{self._board}: no log: {last_line(self._process.stderr.read())}.")
        return min(code, 1)

    def close(self) -> None:
        if self._process.poll() is None:
            self._process.terminate()
        self._process.communicate()
