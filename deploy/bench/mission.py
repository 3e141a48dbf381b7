"""A headless mission of `indoor-mapping local`, watched from outside: its programs are found and measured by /proc.

So it serves any checkout of the project, this one and older ones.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections import defaultdict
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

from common.modules import PACKAGES, Board, on
from deploy.bench.process_cost import command_line, family
from deploy.bench.waiting import BenchFailed, until

HERE = Path(__file__).resolve().parents[2]  # this checkout
FLOOR = "office"  # more than 40 m of hall
WORKERS = "workers of "  # before the name of a program, for what it starts itself
_START_S = 120.0
_END_S = 40.0


class Mission:
    """Of a checkout, in a folder of its own; returns once the robot may drive. Raises BenchFailed."""

    def __init__(self, folder: Path, tree: Path = HERE, nice: int = 0) -> None:
        """`nice`: what its processes begin with, where that is permitted."""
        self._run, self._log = folder / "run", folder / "local.log"
        folder.mkdir(exist_ok=True)
        arguments = ["local", "--headless", "--floor", FLOOR, "--camera", "off", "--out", str(self._run)]
        with self._log.open("wb") as log:
            self._process = subprocess.Popen(
                [_python(tree), "-m", "deploy.cli", *arguments],
                stdout=log,
                stderr=subprocess.STDOUT,
                cwd=tree,
                preexec_fn=partial(_set_niceness, nice) if nice else None,
                env=os.environ | {"PYTHONPATH": str(tree)},
            )
        try:
            until(self._started, _START_S, "the start of the mission")
        except BenchFailed:
            self.end()
            raise

    def _started(self) -> bool:
        if not self.running:
            raise BenchFailed(f"the mission did not start:\n{self.output}")
        return "The mission has started" in self.output

    @property
    def running(self) -> bool:
        return self._process.poll() is None

    @property
    def output(self) -> str:
        """What it has printed so far."""
        return self._log.read_text(encoding="utf-8", errors="replace")

    @property
    def work(self) -> Path:
        """The folder of what only its processes need."""
        return self._run / "process"

    @property
    def config_file(self) -> Path:
        return self.work / "robot.toml"

    def all_processes(self) -> list[int]:
        return family(self._process.pid)

    def programs(self) -> dict[str, list[int]]:
        """Of the BeagleBone: name -> process ids."""
        found: dict[str, list[int]] = defaultdict(list)
        for pid in self.all_processes():
            name = board_program(command_line(pid))
            if name:
                found[name].append(pid)
                workers = [child for child in family(pid)[1:] if not board_program(command_line(child))]
                if workers:
                    found[f"{WORKERS}{name}"] += workers
        return dict(found)

    def end(self) -> None:
        self._process.terminate()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def board_program(words: Sequence[str]) -> str:
    """The name of a program that the BeagleBone runs, from its command line; empty for any other process.

    One module of the robot (`python -m onboard.comm`), or several (`python -m onboard comm+mmu`).
    """
    if "-m" not in words[:-1]:
        return ""
    place = words.index("-m") + 1
    package = words[place]
    if package == "onboard":
        return words[place + 1] if len(words) > place + 1 else ""
    return next((name for name in on(Board.BEAGLEBONE) if PACKAGES.get(name) == package), "")


def _set_niceness(nice: int) -> None:
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, nice)


def _python(tree: Path) -> str:
    """The checkout's own interpreter where it has one; else this one, whose libraries serve as well."""
    own = tree / ".venv" / "bin" / "python"
    return str(own) if own.exists() else sys.executable
