"""Real processes on loopback, each with a port of its own; whatever a test leaves running is killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from common.clock import FreeClock
from common.config import BridgeSection, Config, MeshSection, apart
from common.config_file import config_text
from common.environment import PROCESS_ENVIRONMENT
from common.messages.stop import Permit
from common.messages.topics import ODOMETRY, PERMIT
from common.zenoh_bus import ZenohBus
from deploy.local.ports import reserve_port
from deploy.local.process_table import SHARED
from onboard.comm.stop_record import RECORD_NAME, StopRecord, write_record

ROOT = Path(__file__).resolve().parents[2]
STAND_IN = Path(__file__).with_name("stand_in.py")
_STOOD_STILL_S = 5.0  # longer than any condition takes


def free_endpoint(host: str = "127.0.0.1") -> str:
    return f"tcp/{host}:{reserve_port()}"


def until(condition: Callable[[], object], deadline_s: float = 10.0, what: object = "the condition") -> None:
    """A machine that stood still, and everything on it, has not used up the time."""
    left_s, looked_s = deadline_s, time.monotonic()
    while not condition():
        now_s = time.monotonic()
        left_s, looked_s = left_s - min(now_s - looked_s, _STOOD_STILL_S), now_s
        assert left_s > 0.0, f"{what} did not come true within {deadline_s} s"
        time.sleep(0.005)


def environment() -> dict[str, str]:
    return os.environ | PROCESS_ENVIRONMENT | {"PYTHONPATH": str(ROOT)}


class Mesh:
    """Processes by name, and a bus that watches them."""

    def __init__(self, folder: Path, host: str = "127.0.0.1") -> None:
        """`host`: this machine's address on the link over which the robot is reached."""
        self.folder = folder
        self.config = apart(
            Config(
                mesh=MeshSection(router=free_endpoint(host), laptop_router=free_endpoint()),
                bridge=BridgeSection(serial_port=str(folder / "serial")),
            )
        )
        self.config_file = folder / "robot.toml"
        self.config_file.write_text(config_text(self.config), encoding="utf-8")
        write_record(folder / RECORD_NAME, StopRecord())
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self.permits: list[tuple[float, Permit]] = []  # monotonic time of arrival
        self._bus: ZenohBus | None = None

    @property
    def bus(self) -> ZenohBus:
        if self._bus is None:
            self._bus = ZenohBus("watcher", self.config, FreeClock())
            self._bus.subscribe(PERMIT, lambda permit: self.permits.append((time.monotonic(), permit)))
            self._bus.latest(ODOMETRY)
        return self._bus

    def start(
        self, name: str, *command: str, extra: tuple[str, ...] = (), inside: tuple[str, ...] = ()
    ) -> subprocess.Popen[bytes]:
        """A process of the mesh; without a command, its stand-in (comm: itself). `inside`: words before it all."""
        program = command or (("-m", "onboard.comm") if name == "comm" else (str(STAND_IN), name))
        arguments = [sys.executable, *program, "--config", str(self.config_file), "--log-dir", str(self.folder)]
        with (self.folder / f"{name}.stdout").open("ab") as stdout:
            process = subprocess.Popen(
                [*inside, *arguments, *extra],
                env=environment(),
                cwd=ROOT,
                start_new_session=True,
                stdout=stdout,
                stderr=subprocess.PIPE,
            )
        self.processes[name] = process
        return process

    def start_all(self) -> None:
        """comm and stand-ins for the rest, until the permit is there."""
        for name in ("comm", "bridge", "mmu", "planner"):
            self.start(name)
        until(lambda: self.granted, 20.0, "a permit")

    @property
    def granted(self) -> bool:
        _ = self.bus  # which listens from its first use on
        return bool(self.permits) and self.permits[-1][1].granted

    @property
    def standing(self) -> bool:
        odometry = self.bus.latest(ODOMETRY)
        return odometry is not None and odometry.standing

    def revoked_after(self, since_s: float) -> float:
        """Waits for the first permit that is none; returns how long after `since_s` it came."""
        until(lambda: any(t > since_s and not p.granted for t, p in self.permits), what="the end of the permit")
        return next(t for t, p in self.permits if t > since_s and not p.granted) - since_s

    def signal(self, name: str, number: signal.Signals) -> float:
        """Sends a signal; returns when."""
        now_s = time.monotonic()
        os.kill(self.processes[name].pid, number)
        return now_s

    def command(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """`indoor-mapping` with the mesh's configuration."""
        return run_cli(*arguments, "--config", str(self.config_file))

    def close(self) -> None:
        for process in self.processes.values():
            if process.poll() is None:
                process.kill()
            process.wait()
            if process.stderr is not None:
                process.stderr.close()
        if self._bus is not None:
            self._bus.close()


def run_cli(*arguments: str, **options: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "deploy.cli", *arguments],
        env=environment(),
        cwd=options.pop("cwd", ROOT),
        capture_output=True,
        text=True,
        timeout=options.pop("timeout_s", 60.0),
        check=False,
        **options,
    )


@contextmanager
def local_run(folder: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    """`indoor-mapping local --headless` into the folder, from the start of its mission on; killed in the end."""
    arguments = ["local", "--floor", "straight", "--headless", "--out", str(folder), *options]
    with subprocess.Popen(
        [sys.executable, "-m", "deploy.cli", *arguments],
        env=environment(),
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        assert process.stdout is not None
        heard = []
        for line in process.stdout:
            heard.append(line)
            if "mission has started" in line:
                break
        else:
            pytest.fail("the mission did not start: " + "".join(heard))
        try:
            yield process
        finally:
            process.kill()


def running(pid: int) -> bool:
    """Whether a process runs; one that has ended and was not yet collected does not."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


def children_of(run_dir: Path) -> dict[str, int]:
    """The processes of a run by the names of their modules, found by the run folder in their arguments."""
    found: dict[str, int] = {}
    for folder in Path("/proc").iterdir():
        try:
            arguments = (folder / "cmdline").read_bytes().decode().split("\0") if folder.name.isdigit() else []
        except (FileNotFoundError, ProcessLookupError):
            continue
        if str(run_dir / "process" / "robot.toml") in arguments and "-m" in arguments and running(int(folder.name)):
            package, first = arguments[arguments.index("-m") + 1 :][:2]
            modules = first.split("+") if package == SHARED else [package.split(".")[1]]
            found |= dict.fromkeys(modules, int(folder.name))
    return found


@pytest.fixture
def mesh(tmp_path: Path) -> Iterator[Mesh]:
    made = Mesh(tmp_path)
    yield made
    made.close()
