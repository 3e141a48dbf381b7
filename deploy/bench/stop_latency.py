"""The software stop: from the command on the laptop until the motors of the simulated body are off, at speed 1.

The whole mesh as real processes. Between laptop and robot lies a relay of 2 MB/s: once with the robot's own
messages only, once kept full by photos, which take their usual way: through the outbox into the run database, and to
the programs that show them. The stop itself goes as `indoor-mapping estop` sends it.
"""

from __future__ import annotations

import secrets
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from common.clock import FreeClock
from common.config import BridgeSection, Config, MeshSection, VisualizerSection
from common.config_file import config_text
from common.constants import STARTUP_GRACE_S
from common.messages.mission import Operation
from common.messages.points_of_interest import PointOfInterest
from common.messages.topics import PERMIT, POI, POSE, STATUS
from common.zenoh_bus import ZenohBus
from deploy.bench.machine import percentiles
from deploy.bench.order import Order
from deploy.bench.relay import Relay
from deploy.bench.waiting import BenchFailed, until
from deploy.local.ports import reserve_port
from deploy.local.process_table import program_of
from deploy.local.supervisor import Supervisor
from offboard.operate import operations
from offboard.operate.operations import Answer
from offboard.operate.operator_client import operate, press_stop, request_release
from offboard.operate.software_stop import Demand
from offboard.simulator.run.options import floor_path
from offboard.simulator.run.process import MOTORS_NAME
from onboard.comm.stop_record import RECORD_NAME, StopRecord, write_record

RATE_BYTES_S = 2_000_000
PHOTO_BYTES = 100_000
PHOTO_PERIOD_S = 0.033  # 3 MB/s are offered
STOPS, STOPS_QUICK = 200, 20
FLOOR = "loop"
_WAIT_S = 30.0
_FILL_S = 3.0
_END_S = 5.0


class Photos:
    """Points of interest with photos as `poi` sends them; where `laptop` is given, somebody there looks at them."""

    def __init__(self, robot: Config, laptop: Config | None) -> None:
        self._robot = ZenohBus("poi", robot, FreeClock())
        self._viewer = None if laptop is None else ZenohBus("visualizer", laptop, FreeClock(), "client")
        self._ended = threading.Event()
        self._threads = [threading.Thread(target=run, daemon=True) for run in (self._send, self._look)]
        for thread in self._threads:
            thread.start()

    def _send(self) -> None:
        number = 0
        while not self._ended.wait(PHOTO_PERIOD_S):
            number += 1
            photo = secrets.token_bytes(PHOTO_BYTES)
            record = PointOfInterest(
                time.monotonic(), 1 + number % 50, "Door", str(number), 1.0, 2.0, str(number), "", 1.0, "read", photo
            )
            self._robot.publish(POI, record)

    def _look(self) -> None:
        while self._viewer is not None and not self._ended.wait(0.05):
            self._viewer.take(POI)
            self._viewer.latest(POSE)

    def close(self) -> None:
        self._ended.set()
        for thread in self._threads:
            thread.join()
        self._robot.close()
        if self._viewer is not None:
            self._viewer.close()


class StopMesh:
    """Robot and laptop, the laptop behind the relay."""

    def __init__(self, folder: Path) -> None:
        router, laptop_router = (f"tcp/127.0.0.1:{reserve_port()}" for _ in range(2))
        serial = folder / "serial"
        self.robot = Config(mesh=MeshSection(router), bridge=BridgeSection(serial_port=str(serial)))
        self.relay = Relay(router, RATE_BYTES_S)
        page = VisualizerSection(port=reserve_port())
        across = replace(self.robot, mesh=MeshSection(self.relay.endpoint, laptop_router), visualizer=page)
        self.laptop = replace(self.robot, mesh=MeshSection(laptop_router, laptop_router))
        self._motors = folder / MOTORS_NAME
        self._supervisor = Supervisor(folder)
        write_record(folder / RECORD_NAME, StopRecord())
        (folder / "robot.toml").write_text(config_text(self.robot), encoding="utf-8")
        (folder / "laptop.toml").write_text(config_text(across), encoding="utf-8")
        common = ["--config", str(folder / "robot.toml"), "--log-dir", str(folder)]
        self._start("simulator", [*common, "--floor", str(floor_path(FLOOR).resolve())], restart=False)
        for process in self.robot.beaglebone.processes:
            if process != "bridge":
                self._start(process, common)
        across_common = ["--config", str(folder / "laptop.toml"), "--log-dir", str(folder)]
        self._of_laptop = [*across_common, "--run-dir", str(folder / "run")]
        self._start("recorder", self._of_laptop)
        until(serial.exists, _WAIT_S, "the serial port")
        self._start("bridge", common)
        self._across = across
        self._operator = self._join()
        until(self._granted, STARTUP_GRACE_S, "the permit")

    def _start(self, name: str, arguments: list[str], *, restart: bool = True) -> None:
        self._supervisor.start(name, program_of(name), arguments, restart)

    def _join(self) -> ZenohBus:
        return ZenohBus("command_center", self._across, FreeClock(), "client")

    def join_anew(self) -> None:
        """A program of the operator that was just started: the stop is its first message."""
        self._operator.close()
        self._operator = self._join()
        until(self._granted, _WAIT_S, "the permit")

    def _granted(self) -> bool:
        self._supervisor.check()
        permit = self._operator.latest(PERMIT)
        return permit is not None and permit.granted

    def _stopped(self) -> bool:
        permit = self._operator.latest(PERMIT)
        return permit is not None and bool(permit.stop_sources) and self.motors()[-1][2]

    def motors(self) -> list[tuple[float, bool, bool]]:
        """When, all of both motors turn, all is off."""
        rows = [line.split(",") for line in self._motors.read_text(encoding="utf-8").splitlines()[1:]]
        return [
            (float(t), "0" not in (left, right), (left, right, on) == ("0", "0", "0")) for t, left, right, on in rows
        ]

    def drive(self, operation: Operation) -> None:
        """Until the motors turn."""
        if operate(self._operator, operations.Order(operation)) is not Answer.TAKEN:
            raise BenchFailed(f"the planner did not take the {operation.value}")
        until(lambda: self.motors()[-1][1], _WAIT_S, "driving")

    def start_page(self) -> str:
        """Starts the visualizer on the laptop; returns its address once it reports."""
        self._start("visualizer", self._of_laptop)
        self._operator.latest(STATUS["visualizer"])
        until(lambda: self._operator.latest(STATUS["visualizer"]) is not None, _WAIT_S, "the page")
        return f"http://{self._across.visualizer.host}:{self._across.visualizer.port}/"

    def press(self) -> None:
        """As `indoor-mapping estop` does; returns once the robot has confirmed it."""
        control = press_stop(self._operator)
        if control.latency_s is None:
            raise BenchFailed("the robot did not confirm the stop")

    def stop(self, press: Callable[[], None]) -> float | None:
        """Stops a robot that drives: time from the call of `press` until all is off (s), once the robot holds the stop.

        None where the robot had stopped by itself just before, as it does when a module is late.
        """
        until(lambda: self.motors()[-1][1], _WAIT_S, "driving")
        pressed_s = time.monotonic()
        press()
        until(self._stopped, _WAIT_S, "the robot holding the stop")
        return next((t_s - pressed_s for t_s, _, off in self.motors() if off and t_s > pressed_s), None)

    def release(self) -> None:
        control = request_release(self._operator)
        if control.demand is not Demand.NONE or control.release_failed:
            raise BenchFailed("the robot did not confirm the release")

    def close(self) -> None:
        self._operator.close()
        self._supervisor.end_all(_END_S)
        self.relay.close()


def measure(mesh: StopMesh, count: int) -> list[float]:
    """So many stops of a robot that drives."""
    latencies_s: list[float] = []
    while len(latencies_s) < count:
        mesh.join_anew()
        time.sleep(0.1 * secrets.randbelow(1000) / 1000)  # no stop is in phase with the loop of a node
        latency_s = mesh.stop(mesh.press)
        if latency_s is not None:
            latencies_s.append(latency_s)
        mesh.release()
        mesh.drive(Operation.RESUME)
    return latencies_s


def bench(order: Order) -> None:
    count = STOPS_QUICK if order.quick else STOPS
    with tempfile.TemporaryDirectory(prefix="indoor-mapping-") as folder:
        mesh = StopMesh(Path(folder))
        photos: Photos | None = None
        try:
            mesh.drive(Operation.START)
            print(f"idle link: {percentiles(measure(mesh, count))} of {count} stops", flush=True)
            photos = Photos(mesh.robot, mesh.laptop)
            time.sleep(_FILL_S)
            began_s, relayed = time.monotonic(), mesh.relay.relayed_bytes
            latencies_s = measure(mesh, count)
            share = (mesh.relay.relayed_bytes - relayed) / (time.monotonic() - began_s) / RATE_BYTES_S
            print(f"link of 2 MB/s, {100 * share:.0f} % full: {percentiles(latencies_s)} of {count} stops", flush=True)
        finally:
            if photos is not None:
                photos.close()
            mesh.close()
