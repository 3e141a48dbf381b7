"""The page in a real Chromium: from a published pose to its pixel, what its server costs, from a click to wheels off.

First a large floor: 2000 x 1500 cells, which come anew every second, and 200 points of interest; poses, ranges and
statuses at their rates, over Zenoh, into the visualizer's own process. Then the whole mesh of `bench stop`, while map
and photos stream to the open page.
"""

from __future__ import annotations

import tempfile
import threading
import time
import zlib
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from common.clock import FreeClock
from common.config import Config, MeshSection, VisualizerSection
from common.config_file import config_text
from common.grid_cells import FREE, WALL
from common.messages.health import Status
from common.messages.mapping import GridUpdate, MapUpdate, PoseEstimate
from common.messages.mission import Operation, PlannerView
from common.messages.motion import CarrierReport, CarrierState, Ranges
from common.messages.points_of_interest import PointOfInterest
from common.messages.stop import Permit
from common.messages.topics import CARRIER, GRID, MAP, PERMIT, PLAN, POI, POSE, RANGES, STATUS
from common.zenoh_bus import ZenohBus
from deploy.bench.browser import chromium
from deploy.bench.machine import percentiles
from deploy.bench.order import Order
from deploy.bench.process_cost import threads
from deploy.bench.stop_latency import Photos, StopMesh
from deploy.bench.waiting import BenchFailed, until
from deploy.local.ports import reserve_port
from deploy.local.process_table import program_of
from deploy.local.supervisor import Supervisor

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

ROWS, COLUMNS, CELL_M = 1500, 2000, 0.05
POIS = 200
MAP_POINTS = 20_000
POSES, POSES_QUICK = 600, 150
STOPS, STOPS_QUICK = 200, 20
POSE_PERIOD_S = 0.1
GRID_POSES = 10  # every so many poses a grid
MODULES = ("sim", "car", "bridge", "mmu", "planner", "poi", "comm", "recorder")
VIEWPORT = {"width": 1440, "height": 900}
_WAIT_S = 30.0
_SETTLE_S = 3.0
_DRIVE_S = 15.0  # before the first stop, so that there is a map that grows
_END_S = 5.0

# Of every pose that was drawn, when its frame was done: a task that is posted while a frame is drawn runs after it
WATCH = """() => import('./main.js').then(({ map, model }) => {
    window.shown = [];
    const channel = new MessageChannel();
    let last = null;
    channel.port1.onmessage = ({ data }) => window.shown.push([data, performance.timeOrigin + performance.now()]);
    map.stage.addEventListener("drawn", () => {
        if (!model.pose || model.pose.x_m === last) return;
        last = model.pose.x_m;
        channel.port2.postMessage(last);
    });
})"""
STOP_IS = "(look) => document.querySelector('header .stop').dataset.stop === look"
# Whether the robot is seen where the newest pose is
ROBOT_PIXEL = """() => import('./main.js').then(({ map, model }) => {
    const [x, y] = map.view.toScreen(model.pose.x_m, model.pose.y_m).map((s) => s * map.ratio);
    return map.overlay.getContext("2d").getImageData(x, y, 1, 1).data[3];
})"""


class LargeFloor:
    """A robot on a large floor, by hand, and the visualizer's process beside it."""

    def __init__(self, folder: Path) -> None:
        router, laptop = (f"tcp/127.0.0.1:{reserve_port()}" for _ in range(2))
        page = VisualizerSection(port=reserve_port())
        config = replace(Config(), mesh=MeshSection(router, laptop), visualizer=page)
        self.address = f"http://{page.host}:{page.port}/"
        (folder / "robot.toml").write_text(config_text(config), encoding="utf-8")
        self._buses = [ZenohBus(name, config, FreeClock(), "router") for name in ("comm", "recorder")]
        self._robot = ZenohBus("mmu", config, FreeClock())
        self._buses.append(self._robot)
        self._supervisor = Supervisor(folder)
        arguments = ["--config", str(folder / "robot.toml"), "--log-dir", str(folder)]
        self._supervisor.start("visualizer", program_of("visualizer"), arguments)
        comm = self._buses[0]
        until(lambda: comm.latest(STATUS["visualizer"]) is not None, _WAIT_S, "the page")
        self._publish_floor()

    def __enter__(self) -> LargeFloor:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._supervisor.end_all(_END_S)
        for bus in self._buses:
            bus.close()

    @property
    def server_cpu_s(self) -> float:
        """Processor time of the visualizer's process so far."""
        process = self._supervisor.children["visualizer"].process
        assert process is not None
        return sum(thread.cpu_s for thread in threads([process.pid]).values())

    def _publish_floor(self) -> None:
        """Halls of 2 m with walls between, as far as the cells reach."""
        cells = np.full((ROWS, COLUMNS), FREE, np.uint8)
        cells[::40] = WALL
        self._cells = zlib.compress(cells.tobytes(), 1)
        reach_m = COLUMNS * CELL_M
        xs = np.arange(MAP_POINTS) / MAP_POINTS * reach_m * 20 % reach_m
        ys = np.arange(MAP_POINTS) * 20 // MAP_POINTS * 2.0
        points = np.column_stack([xs, ys]).astype(np.float32)
        for start in range(0, MAP_POINTS, 2000):
            part = points[start : start + 2000]
            self._robot.publish(MAP, MapUpdate(0.0, 1, start, part, np.zeros(len(part), np.uint8)))
        for number in range(1, POIS + 1):
            place = number % 20 * 5.0, number // 20 * 6.0
            record = PointOfInterest(0.0, number, "Door", "", *place, str(100 + number), "Office", 0.9, "read")
            self._robot.publish(POI, record)
        nowhere = np.zeros((0, 2), np.float32)
        self._robot.publish(PLAN, PlannerView(0.0, "FOLLOW", "following a hall", nowhere, 3, 40.0))

    def drive(self, count: int) -> dict[float, float]:
        """So many poses at their rate and all that comes with them; x of each pose -> when it was published."""
        published: dict[float, float] = {}
        due_s = time.monotonic()
        for k in range(1, count + 1):
            due_s += POSE_PERIOD_S
            time.sleep(max(0.0, due_s - time.monotonic()))
            t_s, x_m = POSE_PERIOD_S * k, round(0.02 * k, 2)
            published[x_m] = time.time()
            self._robot.publish(POSE, PoseEstimate(t_s, x_m, 1.0, 0.0, 0.0, 0.02, 0.01, 1))
            self._publish_beside(t_s, k)
        return published

    def _publish_beside(self, t_s: float, k: int) -> None:
        with self._robot.bundling():
            self._robot.publish(RANGES, Ranges(t_s, (1.0,) * 5, (0.0,) * 5))
            self._robot.publish(PERMIT, Permit(t_s, True, ""), news=False)
            carrier = CarrierReport(t_s, CarrierState.MOVING, 0, 0, 0, 0.2, 0, 0, True, False, 11.8)
            self._robot.publish(CARRIER, carrier, news=False)
            for module in MODULES:
                self._robot.publish(STATUS[module], Status(t_s, "RUN", 0, 50_000, True, k), news=False)
        if k % GRID_POSES == 0:
            grid = GridUpdate(t_s, k, 0.0, -1.0, CELL_M, ROWS, COLUMNS, self._cells)
            self._robot.publish(GRID, grid)


def _clock_ahead_s(page: Page) -> float:
    """By how much the page's clock is ahead of this process's, to half of the shortest of some round trips."""
    trips = []
    for _ in range(30):
        left_s = time.time()
        there_s = float(page.evaluate("performance.timeOrigin + performance.now()")) / 1000.0
        back_s = time.time()
        trips.append((back_s - left_s, there_s - (left_s + back_s) / 2))
    return min(trips)[1]


def pose_to_pixel(browser: Browser, count: int) -> None:
    with tempfile.TemporaryDirectory(prefix="indoor-mapping-") as folder, LargeFloor(Path(folder)) as floor:
        page = browser.new_page(viewport=VIEWPORT)  # type: ignore[arg-type]
        page.goto(floor.address)
        floor.drive(round(_SETTLE_S / POSE_PERIOD_S))
        page.wait_for_function("document.querySelectorAll('.marker').length === " + str(POIS))
        page.evaluate(WATCH)
        ahead_s = _clock_ahead_s(page)
        cpu_s, began_s = floor.server_cpu_s, time.monotonic()
        published: dict[float, float] = {}
        driving = threading.Thread(target=lambda: published.update(floor.drive(count)))
        driving.start()
        driving.join()
        share = (floor.server_cpu_s - cpu_s) / (time.monotonic() - began_s)
        if page.evaluate(ROBOT_PIXEL) == 0:
            raise BenchFailed("the robot is not drawn where its pose is")
        shown: list[tuple[float, float]] = page.evaluate("window.shown")
        page.close()
    late_s = [at_ms / 1000.0 - ahead_s - published[x_m] for x_m, at_ms in shown if x_m in published]
    if len(late_s) < count / 2:
        raise BenchFailed(f"only {len(late_s)} of {count} poses were drawn")
    print(f"pose to pixel: {percentiles(late_s)} of {len(late_s)}")
    print(f"its server, with one page: {100 * share:.1f} % of a core", flush=True)


def click_to_wheels_off(browser: Browser, count: int) -> None:
    with tempfile.TemporaryDirectory(prefix="indoor-mapping-") as folder, ExitStack() as stack:
        mesh = StopMesh(Path(folder))
        stack.callback(mesh.close)
        page = browser.new_page(viewport=VIEWPORT)  # type: ignore[arg-type]
        page.goto(mesh.start_page())
        stop = page.locator("header .stop")
        stop.wait_for()
        page.wait_for_function(STOP_IS, arg="IDLE")
        mesh.drive(Operation.START)
        photos = Photos(mesh.robot, None)
        stack.callback(photos.close)
        time.sleep(_DRIVE_S)
        latencies_s: list[float] = []
        while len(latencies_s) < count:
            stop.hover()
            page.mouse.down()
            latency_s = mesh.stop(page.mouse.up)  # which is when a click counts
            if latency_s is not None:
                latencies_s.append(latency_s)
            page.wait_for_function(STOP_IS, arg="LATCHED")  # who has no confirmation yet would press once more
            mesh.release()
            mesh.drive(Operation.RESUME)
        received: dict[str, Any] = page.evaluate(
            "import('./main.js').then(({ model }) => ({ points: model.walls.length, pois: model.pois.length }))"
        )
        page.close()
    beside = f"{received['points']} wall points and {received['pois']} points of interest on the page"
    print(f"click on stop to wheels off: {percentiles(latencies_s)} of {count}; {beside}", flush=True)


def bench(order: Order) -> None:
    with chromium() as browser:
        pose_to_pixel(browser, POSES_QUICK if order.quick else POSES)
        click_to_wheels_off(browser, STOPS_QUICK if order.quick else STOPS)
