"""Every node behind the real way in: bytes are decoded, counted or dropped as on the mesh, then the node steps.

A calm drive along a hall goes on beside whatever else is thrown at the node, so that it has something to work with.
"""

from __future__ import annotations

import tempfile
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from math import cos, sin
from pathlib import Path
from typing import Any

import numpy as np

from common.bus import LocalBus, LocalMesh
from common.codec import encode
from common.config import CommSection, PoiSection
from common.messages.delivery import OutboxPiece, OutboxReceipt
from common.messages.health import LogLine, Status
from common.messages.mapping import GridUpdate, MapUpdate, PoseEstimate, Trajectory
from common.messages.mission import Operation, OperatorCommand, PlannerView
from common.messages.motion import CarrierReport, CarrierState, Distances, Odometry, Ranges
from common.messages.stop import Permit
from common.messages.topics import (
    CARRIER,
    DISTANCES,
    GRID,
    LOG,
    MAP,
    ODOMETRY,
    OPERATION,
    OUTBOX,
    PERMIT,
    PLAN,
    POSE,
    RANGES,
    RECEIPT,
    ROBOT_RECORDED,
    STATUS,
    TOPICS,
    TRAJECTORY,
    Topic,
)
from common.node import Node
from common.recording import Losses, RecordedMessage, RecordingSubscriber
from common.zenoh_inbox import Decoder
from offboard.command_center import log_book, mini_map
from offboard.command_center.command_center import MESSAGE_TOPICS, CommandCenter
from offboard.command_center.widgets import module_table, robot_panel, stop_bar, trouble
from offboard.export.ros_messages import Sent, serialized
from offboard.operate.alerts import Alerts
from offboard.recorder.recorder import Recorder
from offboard.ros.ros import Goal, InitialPose, Ros
from offboard.visualizer.feed import Feed
from offboard.visualizer.visualizer import Visualizer
from onboard.bridge.bridge import Bridge
from onboard.comm.comm import Comm
from onboard.comm.outbox import Outbox
from onboard.comm.outbox_sender import PIECE_BYTES
from onboard.comm.outbox_store import pack_row
from onboard.comm.stop_keeper import StopKeeper
from onboard.comm.stop_record import RECORD_NAME
from onboard.mmu.back_end.map_builder import deferred_back_end
from onboard.mmu.mmu import MappingUnit
from onboard.planner.grid.deliberation import deferred_deliberator
from onboard.planner.planner import Planner
from onboard.poi.poi import Poi
from onboard.poi.signs.reading_job import deferred_reading
from tests.firmware.bench import Bench
from tests.fuzz.wild import UNLIMITED

import msgpack  # isort: skip

CALM_PERIOD_S = 0.1
BOOT_ID = 77
_BY_OUTBOX = {topic.key for topic in ROBOT_RECORDED}


class WireBus(LocalBus):
    """What arrives is bytes. `unread` counts what nothing could be made of."""

    def __init__(self, mesh: LocalMesh, name: str) -> None:
        super().__init__(mesh, name, boot_id=1)
        self.mesh, self.reader = mesh, Decoder()
        self._recording: RecordingSubscriber | None = None
        self._newest: dict[str, bytes] = {}

    def receive(self, topic: Topic[Any], data: bytes) -> None:
        if self._recording is not None and topic.key in self.recorded_keys:
            self._recording.store(topic.key, data)
            self._newest[topic.key] = data
        if topic.key in self.recorded_keys and self.name not in topic.consumers:
            return  # nobody decodes it here
        envelope = self.reader.decode(topic, data)
        if envelope is not None:
            self._receive(topic, envelope.payload, news=True)

    def record(self, topics: Iterable[Topic[Any]], known: Mapping[tuple[str, int], int]) -> None:
        self.recorded_keys = {topic.key for topic in topics}
        self._recording = RecordingSubscriber(self.recorded_keys, (), known, self._reply, lambda: self.mesh.now_s)

    def _reply(self, key: str, query: bytes) -> None:
        """Its producer has the newest message only."""
        if self._recording is not None and key in self._newest:
            self._recording.add_reply(key, msgpack.packb([self._newest[key]]))

    def take_recorded(self) -> list[RecordedMessage]:
        return self._recording.messages() if self._recording is not None else []

    def take_lost(self) -> Losses:
        return self._recording.take_lost() if self._recording is not None else {}


@dataclass
class Stage:
    """A node with its bus, and what goes on beside its step."""

    node: Node
    bus: WireBus
    topics: tuple[Topic[Any], ...]  # that it reads
    beside: Callable[[float], None] = lambda now_s: None
    by_outbox: bool = False  # what the robot says comes `through_outbox`
    folder: tempfile.TemporaryDirectory[str] | None = None
    motors: Callable[[], bool] = lambda: False
    longest: int = UNLIMITED  # rows of the arrays that come

    def close(self) -> None:
        self.node.close()
        if self.folder is not None:
            self.folder.cleanup()


def calm(now_s: float, permit: bool) -> list[tuple[Topic[Any], Any]]:
    """What the robot says now while it drives to and fro in a hall of 1.6 m."""
    x_m, tick = 5.0 + 4.0 * sin(0.04 * now_s), round(now_s / CALM_PERIOD_S)
    speed_m_s = 0.16 * cos(0.04 * now_s)
    ticks = round(x_m / 0.000144)
    said: list[tuple[Topic[Any], Any]] = [
        (ODOMETRY, Odometry(now_s, ticks, ticks, 0.0, 0.0, x_m, 0.0, speed_m_s, False, False, False, 1)),
        (RANGES, Ranges(now_s, (0.8, 1.13, 12.0 - x_m if x_m > 6 else float("nan"), 1.13, 0.8), (0.05,) * 5)),
        (DISTANCES, Distances(now_s, 0.8, 0.8, 12.0 - x_m)),
        (CARRIER, CarrierReport(now_s, CarrierState.MOVING, 1, 0, 0, speed_m_s, 80, 80, True, False, 12.0)),
        (POSE, PoseEstimate(now_s, x_m, 0.0, 0.0, 0.0, 0.05, 0.01, 1)),
        (PERMIT, Permit(now_s, permit, "", challenge=b"c" * 16)),
    ]
    said += [(topic, Status(now_s, "RUN", 0, 50_000, True, tick)) for topic in STATUS.values()]
    if tick % 5 == 0:
        start = tick % 300
        xs = np.linspace(0.0, 12.0, 20, dtype=np.float32)
        points = np.stack([xs, np.where(np.arange(20) % 2, 0.8, -0.8).astype(np.float32)], axis=1)
        said += [
            (MAP, MapUpdate(now_s, 1 + tick // 300, 4 * start, points, np.zeros(20, np.uint8))),
            (PLAN, PlannerView(now_s, "STRAIGHT", "following the hall", points[:5], 2, 40.0)),
        ]
    if tick % 10 == 0:
        cells = np.zeros((60, 160), np.uint8)
        cells[22:38, 5:140] = 1
        cells[[21, 38], 5:140] = 2
        pressed = zlib.compress(cells.tobytes(), 1)
        said += [
            (GRID, GridUpdate(now_s, tick, -1.0, -3.0, 0.1, 60, 160, pressed)),
            (LOG["mmu"], LogLine(now_s, "INFO", "all is well")),
        ]
    if tick % 100 == 0:
        path = np.stack([np.linspace(0, 9, 20), np.zeros(20), np.zeros(20)], axis=1)
        said.append((TRAJECTORY, Trajectory(now_s, np.linspace(0, now_s, 20), path)))
    if tick % 200 == 1:
        said.append((OPERATION, OperatorCommand(now_s, Operation.START, command_id=tick)))
    return said


def _read_by(name: str) -> tuple[Topic[Any], ...]:
    return tuple(topic for topic in TOPICS if name in topic.consumers)


def bridge(bus: WireBus) -> Stage:
    """With the real firmware at the far end of its port."""
    bench = Bench()

    class Port:
        def read(self) -> bytes:
            return bench.board.serial_read()

        def write(self, data: bytes) -> None:
            bench.board.serial_write(data)

        def fileno(self) -> int | None:
            return None

    def beside(now_s: float) -> None:
        for _ in range(round(Bridge.period_s / 0.005)):
            bench.now_us += 5000
            bench.board.imu(0, 0, 16384, 0, 0, bench.gyro_counts(0.0))
            for sonar in bench.board.fired():
                bench.board.echo(sonar, bench.echo_us[sonar])
            bench.board.run(bench.now_us)

    def motors() -> bool:
        left, right, enabled = bench.board.outputs()
        return bool(enabled or left or right)

    return Stage(Bridge(Port), bus, _read_by("bridge"), beside, motors=motors)


def mmu(bus: WireBus) -> Stage:
    worker = deferred_back_end()
    return Stage(MappingUnit(worker), bus, _read_by("mmu"), lambda now_s: worker.work())


def planner(bus: WireBus) -> Stage:
    deliberator = deferred_deliberator()
    return Stage(Planner(deliberator, images_walls=True), bus, _read_by("planner"), lambda now_s: deliberator.work())


def comm(bus: WireBus) -> Stage:
    """With a recorder that acknowledges all it is sent, and keeps none of it in this process."""
    folder = tempfile.TemporaryDirectory()
    outbox = Outbox(Path(folder.name) / "outbox.sqlite", 20_000_000)
    node = Comm(CommSection(), StopKeeper(Path(folder.name) / RECORD_NAME), outbox)
    far = bus.mesh.endpoint("recorder")

    def beside(now_s: float) -> None:
        for piece in far.take(OUTBOX):
            number, offset = piece.number, piece.offset + len(piece.data)
            rows = outbox._sender.rows
            if rows is not None and offset == piece.total_bytes:
                number, offset = rows.end, 0
            receipt = OutboxReceipt(now_s, piece.outbox_id, number, offset, piece.total_bytes, recorder_id=1)
            bus.receive(RECEIPT, encode(receipt, 1, BOOT_ID))

    return Stage(node, bus, _all_heard_by_comm(), beside, folder=folder)


def _all_heard_by_comm() -> tuple[Topic[Any], ...]:
    return tuple(dict.fromkeys((*_read_by("comm"), *ROBOT_RECORDED)))


class NoCamera:
    def preview(self, now_s: float) -> None:
        return None

    def request_full(self) -> None:
        """Never comes."""

    def full(self, now_s: float) -> None:
        return None

    def close(self) -> None:
        """Nothing is held open."""


def poi(bus: WireBus) -> Stage:
    reading = deferred_reading(lambda: lambda job: None)  # type: ignore[arg-type,return-value]
    return Stage(Poi(PoiSection(), NoCamera(), reading), bus, _read_by("poi"))


def recorder(bus: WireBus) -> Stage:
    """What the robot says comes in pieces of its outbox."""
    folder = tempfile.TemporaryDirectory()
    node = Recorder(Path(folder.name), "2026-01-01T00:00:00")
    return Stage(node, bus, _read_by("recorder"), folder=folder, by_outbox=True)


def through_outbox(heard: list[tuple[str, bytes]], row: int) -> list[tuple[str, bytes]]:
    """What the robot says, as row number `row` of an outbox; the rest as it is."""
    said = [(key, data) for key, data in heard if key in _BY_OUTBOX]
    messages = [RecordedMessage(key, BOOT_ID, 1000 * row + i, data) for i, (key, data) in enumerate(said)]
    rows = msgpack.packb([[row, pack_row(messages, {})]])
    pieces = [
        OutboxPiece(0.0, 5, row, at, len(rows), rows[at : at + PIECE_BYTES]) for at in range(0, len(rows), PIECE_BYTES)
    ]
    return [(OUTBOX.key, encode(piece, 1, BOOT_ID)) for piece in pieces] + [h for h in heard if h[0] not in _BY_OUTBOX]


class NoServer:
    running, pages, address = True, 1, "http://127.0.0.1/"

    def start(self) -> None:
        """Nobody looks."""

    def close(self) -> None:
        """Nobody looked."""


PIECES = ("plan", "map", "modules", "pois", "trail", "grid", "vitals", "health")  # channels of the page that may wait


def visualizer(bus: WireBus) -> Stage:
    feed = Feed()
    client = feed.client()

    def beside(now_s: float) -> None:
        while client.urgent() is not None or any(client.bulk(channel) is not None for channel in PIECES):
            pass
        client.heartbeat()

    return Stage(Visualizer(feed, NoServer()), bus, _read_by("visualizer"), beside)  # type: ignore[arg-type]


def command_center(bus: WireBus) -> Stage:
    """With all that its screen makes of it."""
    now = [0.0]
    node = CommandCenter(lambda: now[0])
    book = log_book.LogBook(filter=log_book.LogFilter("DEBUG", topics=frozenset(t.key for t in MESSAGE_TOPICS)))
    node.show_messages(book.filter.topics)
    alerts, count = Alerts(), 0

    def beside(now_s: float) -> None:
        nonlocal count
        count += 1
        now[0] = now_s
        book.add(node.take_log())
        if count % 4:
            return
        snapshot = node.snapshot()
        stop_bar.bar_text(snapshot)
        for row in snapshot.rows:
            module_table.cells(row)
        trouble.trouble_text(snapshot.rows, "sim")
        robot_panel.all_lines(snapshot, "http://127.0.0.1:8080/")
        alerts.news(snapshot.reasons, now_s, known=snapshot.view is not None)
        if count % 20 == 0:
            mini_map.draw(node.floor_picture(), 60, 20)

    return Stage(node, bus, tuple(dict.fromkeys((*_read_by("command_center"), *MESSAGE_TOPICS))), beside)


class NoGraph:
    """Every message is made, and goes nowhere."""

    def publish(self, sent: Sent) -> None:
        serialized(sent[1])

    def take_wishes(self) -> list[Goal | InitialPose]:
        return []

    def close(self) -> None:
        """Nothing is open."""


def ros(bus: WireBus) -> Stage:
    return Stage(Ros(NoGraph(), lambda: 1.7e9 + bus.mesh.now_s), bus, _read_by("ros"))


STAGES: dict[str, Callable[[WireBus], Stage]] = {
    make.__name__: make for make in (bridge, mmu, planner, comm, poi, recorder, visualizer, command_center, ros)
}


def stage_of(name: str, mesh: LocalMesh) -> Stage:
    return STAGES[name](WireBus(mesh, name))
