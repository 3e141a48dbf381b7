"""Keeps real processes running as systemd does on the boards: each in a group of its own, restarted when it dies,
ended with everything it started when this one ends, however that comes about.
"""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from common.environment import PROCESS_ENVIRONMENT

RESTART_PAUSE_S = 1.0  # RestartSec of the units
SHORT_LIFE_S = 5.0
SHORT_LIVES_MAX = 5  # a process that dies so often so soon will not come up at all
_ROOT = Path(__file__).resolve().parents[2]

_log = logging.getLogger("local")


class ProcessFailed(Exception):
    """A process that must run does not: one sentence with its name and log; `exit_code` is what to end with."""

    def __init__(self, sentence: str, exit_code: int) -> None:
        super().__init__(sentence)
        self.exit_code = exit_code


@dataclass(slots=True)
class Child:
    name: str
    command: Sequence[str]
    stderr: Path
    restart: bool
    process: subprocess.Popen[bytes] | None = None
    started_s: float = 0.0
    died_s: float | None = None
    short_lives: int = 0

    def last_error_line(self) -> str:
        """The last line that the process wrote to stderr."""
        try:
            lines = self.stderr.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        except OSError:
            lines = []
        return lines[-1] if lines else f"{self.name} ended without a message"


@dataclass
class Supervisor:
    """`start` processes, call `check` a few times a second, `end_all` in `finally`."""

    log_dir: Path
    children: dict[str, Child] = field(default_factory=dict)
    settled: bool = False  # after start-up a process that cannot begin is tried again, before it ends the whole

    def start(self, name: str, program: Sequence[str], arguments: Sequence[str], restart: bool = True) -> None:
        """Starts `python -m program arguments`, which ends with this process."""
        command = [sys.executable, "-m", *program, "--parent", str(os.getpid()), *arguments]
        child = Child(name, command, self.log_dir / f"{name}.stderr", restart)
        self.children[name] = child
        self._spawn(child)

    def check(self) -> None:
        """Restarts processes that ended; raises ProcessFailed for one that cannot be restarted."""
        for child in self.children.values():
            if child.process is None:
                if child.died_s is not None and time.monotonic() - child.died_s >= RESTART_PAUSE_S:
                    self._spawn(child)
                continue
            code = child.process.poll()
            if code is not None:
                self._bury(child, code)

    def end(self, name: str, timeout_s: float) -> None:
        """Ends one process, first politely."""
        child = self.children.get(name)
        if child is not None and child.process is not None:
            self._signal(child, signal.SIGTERM)
            self._wait(child, timeout_s)
            child.process, child.died_s = None, None

    def end_all(self, timeout_s: float) -> None:
        """Ends every process that was started; kills those that do not end in time."""
        running = [child for child in self.children.values() if child.process is not None]
        for child in running:
            self._signal(child, signal.SIGTERM)
        deadline_s = time.monotonic() + timeout_s
        for child in running:
            self._wait(child, max(0.0, deadline_s - time.monotonic()))
            child.process = None

    def _spawn(self, child: Child) -> None:
        environment = os.environ | PROCESS_ENVIRONMENT
        environment["PYTHONPATH"] = os.pathsep.join(filter(None, (str(_ROOT), os.environ.get("PYTHONPATH"))))
        with child.stderr.open("ab") as stderr:
            child.process = subprocess.Popen(
                child.command,
                stdin=subprocess.DEVNULL,
                stdout=stderr,
                stderr=stderr,
                env=environment,
                start_new_session=True,
            )
        child.started_s, child.died_s = time.monotonic(), None

    def _bury(self, child: Child, code: int) -> None:
        lived_s = time.monotonic() - child.started_s
        child.process, child.died_s = None, time.monotonic()
        child.short_lives = child.short_lives + 1 if lived_s < SHORT_LIFE_S else 0
        if code == 2 and not self.settled:
            raise ProcessFailed(child.last_error_line(), 2)
        _log.warning("process died name=%s exit=%d lived_s=%.1f", child.name, code, lived_s)
        if not child.restart or child.short_lives > SHORT_LIVES_MAX:
            raise ProcessFailed(f"{child.name} ended with exit code {code}; its log is in {self.log_dir}.", 1)

    @staticmethod
    def _signal(child: Child, number: signal.Signals) -> None:
        assert child.process is not None
        if child.process.poll() is None:
            os.killpg(child.process.pid, number)

    def _wait(self, child: Child, timeout_s: float) -> None:
        assert child.process is not None
        try:
            child.process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            _log.warning("process killed, it did not end name=%s", child.name)
            self._signal(child, signal.SIGKILL)
            child.process.wait()
