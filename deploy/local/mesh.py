"""`indoor-mapping local`: the whole mesh as real processes on loopback, with the simulator behind a serial port.

Everything of the run stands in the run folder; what only the processes need (robot.toml, logs, serial port, stop
record) in its `process` folder.
"""

from __future__ import annotations

import importlib.util
import logging
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

from common.clock import FreeClock
from common.constants import STARTUP_GRACE_S
from common.errors import StartError
from common.messages.mission import Operation, OperatorCommand, Outcome, PlannerView
from common.messages.stop import Permit
from common.messages.topics import OPERATION, PERMIT, PLAN, STATUS
from common.mission_state import started
from common.stop_signals import end_on_signals
from common.zenoh_bus import ZenohBus
from common.zones import ZONE_OPERATIONS
from deploy.local.configuration import RunPaths, mesh_config, process_arguments
from deploy.local.process_table import SIMULATOR, program_of, without
from deploy.local.report import summarise
from deploy.local.supervisor import ProcessFailed, Supervisor
from deploy.local.terminal_ui import Left, TerminalUi, has_terminal
from offboard.evaluate.run_text import progress
from offboard.ros import INSTALL
from offboard.simulator.run.options import RunOptions, load_world, prepare_folder

SERIAL_WAIT_S = 30.0
END_TIMEOUT_S = 5.0
RECORDER_TIMEOUT_S = 30.0
RECORDED_TIMEOUT_S = 10.0
UNWATCHED_S = 5.0  # a page that lost its server is back within two seconds
_POLL_S = 0.1
_START_POLL_S = 0.02
_PROGRESS_PERIOD_S = 5.0
_START_PERIOD_S = 0.5

_log = logging.getLogger("local")


class Interrupted(Exception):
    """Somebody wants the mesh to end before the mission does."""


def run_local(options: RunOptions) -> int:
    """Runs the mesh until the mission is finished or somebody ends it; returns the exit code."""
    stop = threading.Event()
    end_on_signals(stop)
    load_world(options)
    if importlib.util.find_spec("mujoco") is None:
        raise StartError("The simulator needs MuJoCo: run ./deploy/local.sh --setup-only once.")
    if options.ros and importlib.util.find_spec("rclpy") is None:
        raise StartError(f"The process ros needs rclpy. {INSTALL}")
    folder = prepare_folder(options).resolve()
    (folder / "process").mkdir(exist_ok=True)
    console = _set_up_log(folder / "process" / "local.log")
    mesh = LocalRun(options, folder, stop, console)
    try:
        return mesh.run()
    except Interrupted:
        if mesh.exit_code == 0:
            return 0
        print("Ended before the mission was finished.", file=sys.stderr)
        return 130
    except ProcessFailed as failure:
        print(failure, file=sys.stderr)
        return failure.exit_code
    finally:
        mesh.close()


def _set_up_log(file: Path) -> logging.Handler:
    """All into the file, warnings to the terminal too, by the handler that is returned."""
    console = logging.StreamHandler()
    console.setLevel(logging.WARNING)
    logging.basicConfig(
        level=logging.INFO, format="%(levelname)s %(name)s %(message)s", handlers=[logging.FileHandler(file), console]
    )
    return console


class LocalRun:
    """One run of the mesh. `run` once, then `close`."""

    def __init__(self, options: RunOptions, folder: Path, stop: threading.Event, console: logging.Handler) -> None:
        self._options = options
        self._stop = stop
        self._socket_folder = tempfile.TemporaryDirectory(prefix="indoor-mapping-")
        self._paths = paths = RunPaths(folder, Path(self._socket_folder.name) / "frames")
        paths.clear()
        self._config = mesh_config(options, paths)
        self._supervisor = Supervisor(paths.work)
        self._bus: ZenohBus | None = None
        self._started_wall_s = time.monotonic()
        self._began_s: float | None = None  # on the mission's clock
        self._person_halted = False  # stopped or paused, and nobody has let the robot go on since
        self._outcome = Outcome.NONE  # of the mission, as the Planner published it last
        self._console = console
        self._screen: TerminalUi | None = None
        self._ends_with_mission = True

    @property
    def exit_code(self) -> int:
        """0 where the mission has ended as it should, or as a person ordered."""
        return self._outcome.exit_code

    def run(self) -> int:
        print(
            f"Starting the robot on the floor {self._options.floor.stem}; run folder {self._paths.folder}", flush=True
        )
        self._start_processes()
        # Under a name of its own: the token of the command center is the Command Center's
        self._bus = bus = ZenohBus("local", self._config, FreeClock())
        bus.latest(PLAN)
        self._await_ready(bus)
        self._supervisor.settled = True
        page = self._config.visualizer
        print(f"All modules are ready. The live map: http://{page.host}:{page.port}/", flush=True)
        if self._options.headless:
            self._start_mission(bus)
        elif has_terminal():
            self._open_screen()
        else:
            print(f"Start the mission with: indoor-mapping start --config {self._paths.config}", flush=True)
        try:
            self._await_finish(bus)
        finally:
            # What was mapped until a person, or a fault, ended the run is worth its summary too
            view, permit = bus.latest(PLAN), bus.latest(PERMIT)
            self._close_screen()
            self._end_in_order()
            if view is not None and self._began_s is not None:
                self._summarise(view, permit, self._began_s)
        self._keep_page()
        return self.exit_code

    def _keep_page(self) -> None:
        """The map stays for who looks at it; a run that nobody watches in a terminal ends at once."""
        run = self._paths.folder
        print(f"To look at it again: indoor-mapping view {run}", flush=True)
        if not has_terminal():
            return
        from offboard.visualizer.run_view import recorded_run, serve  # here, because no run needs them before its end

        def on_address(address: str) -> None:
            print(f"The map stays at {address} while a page is open there; Ctrl-C ends.", flush=True)

        try:
            serve(recorded_run(run), self._config.visualizer, self._stop, on_address, UNWATCHED_S)
        except StartError as error:
            _log.warning("%s", error)

    def close(self) -> None:
        """Ends every process that was started."""
        self._close_screen()
        if self._bus is not None:
            self._bus.close()
        self._supervisor.end("recorder", RECORDER_TIMEOUT_S)
        self._supervisor.end_all(END_TIMEOUT_S)
        self._socket_folder.cleanup()

    def _start_processes(self) -> None:
        """Starts all at once except the bridge: without its port it would retry only after a second."""
        # The command center takes a terminal: it is opened in this one, where there is one
        absent = {"command_center", "bridge"} | ({"poi"} if self._options.camera == "off" else set())
        self._start(SIMULATOR, restart=False)
        for process in self._config.processes:
            self._start(without(process, absent))
        self._until(self._paths.serial.exists, SERIAL_WAIT_S, lambda: "The simulator opened no serial port.")
        self._start("bridge")

    def _start(self, process: str, *, restart: bool = True) -> None:
        if process:
            self._supervisor.start(process, program_of(process), self._arguments(process), restart)

    def _arguments(self, name: str) -> list[str]:
        return process_arguments(name, self._options, self._paths)

    def _until(self, condition: Callable[[], bool], timeout_s: float, complaint: Callable[[], str]) -> None:
        deadline_s = time.monotonic() + timeout_s
        while not condition():
            self._supervisor.check()
            if time.monotonic() > deadline_s:
                raise ProcessFailed(complaint(), 1)
            if self._stop.wait(_START_POLL_S):
                raise Interrupted

    def _await_ready(self, bus: ZenohBus) -> None:
        def ready() -> bool:
            permit, recorder = bus.latest(PERMIT), bus.latest(STATUS["recorder"])
            return permit is not None and permit.granted and recorder is not None and recorder.ready

        def complaint() -> str:
            permit = bus.latest(PERMIT)
            reason = permit.reason if permit is not None else "comm is silent"
            return f"The modules did not become ready: {reason}; their logs are in {self._paths.work}."

        self._until(ready, STARTUP_GRACE_S, complaint)

    def _start_mission(self, bus: ZenohBus) -> None:
        next_s = 0.0

        def begun() -> bool:
            nonlocal next_s
            view = bus.latest(PLAN)
            if view is not None and started(view):
                self._began_s = view.t_s
                return True
            if time.monotonic() >= next_s:
                next_s = time.monotonic() + _START_PERIOD_S
                bus.publish(OPERATION, OperatorCommand(time.monotonic(), Operation.START))
            return False

        self._until(begun, STARTUP_GRACE_S, lambda: "The planner did not take the start command.")
        print("The mission has started.", flush=True)

    def _open_screen(self) -> None:
        """From here on the terminal is the Command Center's; the mesh ends when a person ends it there."""
        self._ends_with_mission = False
        self._console.setLevel(logging.CRITICAL + 1)
        arguments = [
            "--config",
            str(self._paths.config),
            "--log-dir",
            str(self._paths.work),
            "--run-dir",
            str(self._paths.folder),
        ]
        self._screen = TerminalUi(arguments)

    def _close_screen(self) -> None:
        if self._screen is not None:
            self._screen.close()
            self._screen = None
            self._console.setLevel(logging.WARNING)

    def _look_after_screen(self) -> None:
        """Raises Interrupted when a person has left it with the mesh."""
        left = self._screen.left() if self._screen is not None else None
        if left is None:
            return
        self._close_screen()
        if left is Left.END:
            raise Interrupted
        why = "" if left is Left.KEEP else f"The Command Center ended by itself; its log is in {self._paths.work}. "
        reopen = f"indoor-mapping command-center --config {self._paths.config}"
        print(f"{why}The mesh goes on; Ctrl-C ends it. To look at it again: {reopen}", flush=True)

    def _await_finish(self, bus: ZenohBus) -> None:
        next_s = time.monotonic() + _PROGRESS_PERIOD_S
        while True:
            self._supervisor.check()
            self._look_after_screen()
            view = bus.latest(PLAN)
            if view is not None:
                if self._began_s is None and started(view):
                    self._began_s = view.t_s
                if self._options.headless:
                    self._start_again(bus, view)
                self._outcome = view.outcome
                if self._outcome.ends_mission and self._ends_with_mission:
                    print(f"The mission has ended: {view.detail}.", flush=True)
                    self._await_recorded(bus)
                    return
                if time.monotonic() >= next_s and self._began_s is not None and self._screen is None:
                    next_s = time.monotonic() + _PROGRESS_PERIOD_S
                    print(progress(view.t_s - self._began_s, view, bus.latest(PERMIT)), flush=True)
            if self._stop.wait(_POLL_S):
                raise Interrupted

    def _start_again(self, bus: ZenohBus, view: PlannerView) -> None:
        """Sends start to a planner that was restarted, but not after a person stopped or paused the robot."""
        permit = bus.latest(PERMIT)
        for command in bus.take(OPERATION):
            if command.operation not in ZONE_OPERATIONS:
                self._person_halted = command.operation is Operation.PAUSE
        if permit is not None and permit.stop_sources:
            self._person_halted = True
        if not started(view) and permit is not None and permit.granted and not self._person_halted:
            bus.publish(OPERATION, OperatorCommand(time.monotonic(), Operation.START))

    def _await_recorded(self, bus: ZenohBus) -> None:
        """Waits until the database holds the end of the mission, for a limited time."""

        def recorded() -> bool:
            status = bus.latest(STATUS["recorder"])
            return status is not None and status.state == "finished"

        try:
            self._until(recorded, RECORDED_TIMEOUT_S, lambda: "The recorder did not get the end of the mission.")
        except ProcessFailed as failure:
            _log.warning("%s", failure)

    def _end_in_order(self) -> None:
        """The recorder first: it writes what it holds. Then the simulator, for the true path."""
        if self._bus is not None:
            self._bus.close()
        self._supervisor.end("recorder", RECORDER_TIMEOUT_S)
        self._supervisor.end("simulator", END_TIMEOUT_S)
        self._supervisor.end_all(END_TIMEOUT_S)

    def _summarise(self, view: PlannerView, permit: Permit | None, began_s: float) -> None:
        folder, wall_s = self._paths.folder, time.monotonic() - self._started_wall_s
        try:
            print(summarise(folder, self._paths.work, self._options, view, permit, began_s, wall_s), flush=True)
        except OSError as error:
            raise ProcessFailed(f"The summary cannot be written to {folder}: {error.strerror}.", 1) from error
