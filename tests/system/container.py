"""A booted Debian with systemd as its first process, on this machine: where a board's units run as they will."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from tests.system.conftest import until

BOOT_S = 60.0
END_S = 30.0


class Container:
    """Over a root folder that stays as it is, unless it `keeps` what is written.

    `shown`: folder or file here -> path inside, for reading.
    """

    def __init__(self, root: Path, shown: dict[Path, str], *, keeps: bool = False) -> None:
        binds = [f"--bind-ro={source}:{target}" for source, target in shown.items()]
        # Without machined and with a network of its own, of which there is the loopback only
        options = ("--quiet", "--register=no", "--keep-unit", "--private-network")
        options += () if keeps else ("--volatile=overlay",)
        end = "--kill-signal=SIGRTMIN+3"  # systemd powers off
        self._process = subprocess.Popen(
            ["systemd-nspawn", *options, end, f"--directory={root}", *binds, "--boot"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        self._leader = 0
        until(self._booted, BOOT_S, "the container's boot")
        subprocess.run(["nsenter", "-t", str(self._leader), "-n", "ip", "link", "set", "lo", "up"], check=True)

    def _booted(self) -> bool:
        assert self._process.poll() is None, "the container ended"
        children = Path(f"/proc/{self._process.pid}/task/{self._process.pid}/children").read_text().split()
        if not children:
            return False
        self._leader = int(children[0])
        return self.run("systemctl", "is-system-running").stdout.strip() in ("running", "degraded")

    def run(self, *words: str) -> subprocess.CompletedProcess[str]:
        """A command inside, as root."""
        inside = ("nsenter", "-t", str(self._leader), "-m", "-u", "-i", "-n", "-p")
        return subprocess.run([*inside, *words], capture_output=True, text=True, check=False, timeout=120)

    def ok(self, *words: str) -> str:
        """The output of a command that must succeed."""
        done = self.run(*words)
        assert done.returncode == 0, f"{words}: {done.stdout}{done.stderr}"
        return done.stdout.strip()

    def of_unit(self, unit: str, value: str) -> str:
        return self.ok("systemctl", "show", "--property", value, "--value", unit)

    def until_unit(self, unit: str, value: str, holds: Callable[[str], bool], deadline_s: float) -> float:
        """Waits for a property of a unit; returns how long."""
        began_s = time.monotonic()
        until(lambda: holds(self.of_unit(unit, value)), deadline_s, f"{value} of {unit}")
        return time.monotonic() - began_s

    def journal(self) -> str:
        return self.ok("journalctl", "--no-pager", "--output=short-monotonic")

    def cut_power(self) -> None:
        """All processes are gone at once; what they have written stays."""
        os.kill(self._leader, signal.SIGKILL)
        self._process.wait(END_S)

    def close(self) -> None:
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)
            try:
                self._process.wait(END_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
        self._process.wait()
