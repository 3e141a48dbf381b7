"""THE message table: one frozen dataclass per payload, one topic per variable, one place for who tells what to whom.

Key on the bus: `<robot>/<module>/<variable>`. Every payload has `t_s`, when its content was measured on the sender's
clock; every output has `valid`, false when an input it rests on was not alive and valid. Sequence number and boot id
travel in the envelope (`codec.Envelope`), stamped by the bus. The codec holds an array to the shape that is annotated,
where a letter stands for one and the same number in all of a message. Add fields with a default, never reuse or rename
one: old recordings must load.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Annotated, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from common.constants import MAP_RATE_MAX_HZ, PERMIT_RATE_HZ, POSE_RATE_HZ, SENSOR_RATE_HZ, STATUS_RATE_HZ

MAP_POINTS_MAX = 2_000_000  # fifty kilometres of wall

# The specification's names of the senders on the serial line and in the text form, and the process that speaks for each
MODULES: dict[str, str] = {
    "SIM": "sim",
    "CAR": "car",
    "MMU": "mmu",
    "PLN": "planner",
    "POI": "poi",
    "CM": "comm",
    "VSL": "visualizer",
    "CC": "command_center",
}
NAME_OF_MODULE = {process: name for name, process in MODULES.items()} | {"bridge": "SIM", "recorder": "CM"}


class Stance(Enum):
    """How a topic travels, and why."""

    LATEST = "newest wins, older ones are dropped: an old reading is worth nothing once a newer one is there"
    COMMAND = "real-time priority, repeated until acknowledged: it must arrive, and soon"
    EVENT = "reliable and in order, through the outbox: nothing may be lost"
    STATE = "a snapshot, answered to a query too: who joins late or missed some must be able to catch up"
    BULK = "lowest priority, a piece at a time, sent again until acknowledged: what is stored must not delay what lives"


class Speed(IntEnum):
    """Desired_Speed: the signed enum of decisions 1 and 14."""

    REVERSE = -1
    STOP = 0
    MEDIUM = 1
    HIGH = 2


class CarrierState(Enum):
    """The firmware's safety state."""

    BOOT = "BOOT"
    DISARMED = "DISARMED"
    READY = "READY"
    MOVING = "MOVING"
    BACKING_OFF = "BACKING"
    STOPPED = "STOPPED"
    FAULT = "FAULT"


@dataclass(frozen=True, slots=True)
class Odometry:
    """What SIM knows of its own motion (SIM_MR_02..04): cumulative ticks, yaw and dead reckoning since power-on."""

    t_s: float
    ticks_left: int
    ticks_right: int
    yaw_rad: float
    yaw_rate_rad_s: float
    x_m: float
    y_m: float
    speed_m_s: float
    standing: bool  # wheels still, gyro bias being tracked
    bumper: bool
    cliff: bool
    session: int  # changes when the board restarts: ticks and yaw begin anew
    valid: bool = True
    yaw_by_walls_rad: float = 0.0  # that much of `yaw_rad` is told by walls, the rest by the gyro


@dataclass(frozen=True, slots=True)
class Ranges:
    """dist_Sensors_Array: five ranges from the ring's centre, NaN where nothing answered (no information)."""

    t_s: float
    range_m: tuple[float, ...]  # in the order of constants.SONAR_NAMES
    age_s: tuple[float, ...]  # how long before t_s each was measured
    valid: bool = True


@dataclass(frozen=True, slots=True)
class Distances:
    """dist_left, dist_right, dist_front: aggregated distances from the ring's centre to the walls, NaN where none."""

    t_s: float
    left_m: float
    right_m: float
    front_m: float
    valid: bool = True


@dataclass(frozen=True, slots=True)
class CarrierReport:
    """Completed and the state of the Carrier, ten times a second and at once on change."""

    t_s: float
    state: CarrierState
    command_id: int  # the drive command in force, 0 = none
    completed_id: int  # the newest one completed
    aborted_id: int  # the newest one given up
    speed_m_s: float
    pwm_left: int
    pwm_right: int
    enabled: bool  # motor driver
    stop_latched: bool
    battery_v: float
    valid: bool = True
    boot: int = 0  # of the drive commands whose ids stand above
    board_epoch: int = 0  # the newest stop epoch that the firmware knows
    bridge_epoch: int = 0  # the newest that the bridge received in a permit, 0 = none since its start
    comm_life: int = 0  # of the newest permit that the bridge received
    stop_ids: tuple[int, ...] = ()  # stops that the bridge holds and no permit has quoted yet
    stop_names: tuple[str, ...] = ()  # their sources, in the same order
    button_pressed: bool = False  # the robot's own stop button, right now


@dataclass(frozen=True, slots=True)
class DriveCommand:
    """Desired_Speed and Desired_Angle: drive at `speed` along `yaw_rad` of SIM's own yaw. Newer replaces older."""

    t_s: float
    command_id: int
    speed: Speed
    yaw_rad: float
    valid: bool = True
    boot: int = 0  # of the planner: a restarted one counts its commands anew; 16 bits


@dataclass(frozen=True, slots=True)
class PoseEstimate:
    """Where the robot is in the map (frame: its start pose), with its uncertainty, tied to SIM's yaw at that moment."""

    t_s: float
    x_m: float
    y_m: float
    heading_rad: float
    yaw_rad: float  # SIM's yaw at t_s: heading_rad - yaw_rad turns a map heading into a drive command
    sd_xy_m: float
    sd_heading_rad: float
    map_revision: int
    valid: bool = True


@dataclass(frozen=True, slots=True)
class MapUpdate:
    """Wall points. `start` 0 begins the map anew (the past was corrected); else the points go on where `start` says."""

    t_s: float
    revision: int
    start: int
    points_m: Annotated[npt.NDArray[np.float32], ("N", 2)]
    inferred: Annotated[npt.NDArray[np.uint8], ("N",)]  # 1 where a wall was concluded, not echoed
    valid: bool = True

    def __post_init__(self) -> None:
        if not 0 <= self.start <= MAP_POINTS_MAX:
            raise ValueError(f"no map goes on at its point {self.start}")


@dataclass(frozen=True, slots=True)
class GridUpdate:
    """The occupancy grid for driving: 0 unknown, 1 free, 2 wall; zlib over the row-major cells."""

    t_s: float
    revision: int
    origin_x_m: float  # outer corner of cell (0, 0)
    origin_y_m: float
    cell_m: float
    rows: int  # along y
    columns: int  # along x
    cells_zlib: bytes
    valid: bool = True


@dataclass(frozen=True, slots=True)
class Trajectory:
    """The smoothed path as it is believed now: times and poses of the key frames."""

    t_s: float
    times_s: Annotated[npt.NDArray[np.float64], ("K",)]
    poses: Annotated[npt.NDArray[np.float64], ("K", 3)]  # x, y, heading
    valid: bool = True


@dataclass(frozen=True, slots=True)
class PlannerView:
    """What the Planner is about, for people: mode, where it drives, what is still on the list."""

    t_s: float
    mode: str
    detail: str
    path_m: Annotated[npt.NDArray[np.float32], ("N", 2)]
    halls_open: int
    area_m2: float
    finished: bool
    valid: bool = True
    command_id: int = 0  # of the newest OperatorCommand that was taken


class PoiCommand(Enum):
    STOP = "STOP"
    CONTINUE = "CONTINUE"
    REVERSE = "REVERSE"
    GOTO = "GOTO"


@dataclass(frozen=True, slots=True)
class PoiRequest:
    """Planner_Command: hold, go on, go back, or stand at a pose for another photo."""

    t_s: float
    command: PoiCommand
    x_m: float = 0.0
    y_m: float = 0.0
    heading_rad: float = 0.0
    valid: bool = True


@dataclass(frozen=True, slots=True)
class PointOfInterest:
    """Current_POI: one record per door (decision 28)."""

    t_s: float
    poi_id: int
    name: str
    description: str
    x_m: float
    y_m: float
    number: str
    room_type: str
    confidence: float
    state: str
    photo_jpeg: bytes = b""
    valid: bool = True


@dataclass(frozen=True, slots=True)
class Permit:
    """May the robot move? Granted only while every on-robot module is alive, fresh, valid and beats, and the newest
    latched stop was released and followed by a resume."""

    t_s: float
    granted: bool
    reason: str
    stop_sources: tuple[str, ...] = ()  # who holds the latched stop
    valid: bool = True
    challenge: bytes = b""  # what a command must be signed over now; empty where none need be
    stop_epoch: int = 0  # grows with every latched stop; 0: comm does not know it yet
    stop_ids: tuple[int, ...] = ()  # the newest stops that are latched in this epoch
    resumed: bool = True  # a resume was given since this epoch's stop was released
    life: int = 0  # of comm: another number after each restart


@dataclass(frozen=True, slots=True)
class StopRequest:
    """e-Stop command: latch the software stop, or release the epoch it names. Repeated until the robot confirms."""

    t_s: float
    source: str
    latched: bool
    valid: bool = True
    stop_id: int = 0  # of this press, drawn at random; its repeats carry the same
    epoch: int = 0  # which stop is released: the `stop_epoch` that the person saw


class Operation(Enum):
    START = "start"
    PAUSE = "pause"
    RESUME = "resume"
    HOME = "home"
    GOTO = "goto"


@dataclass(frozen=True, slots=True)
class OperatorCommand:
    """What a person asks of the mission."""

    t_s: float
    operation: Operation
    x_m: float = 0.0
    y_m: float = 0.0
    valid: bool = True
    command_id: int = 0  # repeated with the same one until PlannerView acknowledges it; 0 = wants no answer
    epoch: int = 0  # of a resume: the stop epoch after which the robot may go on


@dataclass(frozen=True, slots=True)
class Status:
    """State, error code and memory of a module (CC_MR_03), ten times a second."""

    t_s: float
    state: str
    error_code: int
    memory_kb: int
    ready: bool
    beats: int  # passes of the module's own loop
    detail: str = ""
    valid: bool = True


@dataclass(frozen=True, slots=True)
class LogLine:
    t_s: float
    level: str
    text: str
    valid: bool = True


@dataclass(frozen=True, slots=True)
class ClockTick:
    """Simulated time, under `local --speed N` only, and what was published before it: newest message of each topic."""

    t_s: float
    speed: float
    topics: tuple[str, ...] = ()
    boot_ids: tuple[int, ...] = ()
    sequences: tuple[int, ...] = ()
    valid: bool = True


@dataclass(frozen=True, slots=True)
class ClockAck:
    """A process has nothing to do before `t_s` of simulated time: the clock may go there, and a little further.

    With it, what the process published since its last answer.
    """

    t_s: float
    module: str
    topics: tuple[str, ...] = ()
    boot_ids: tuple[int, ...] = ()
    sequences: tuple[int, ...] = ()
    valid: bool = True


@dataclass(frozen=True, slots=True)
class OutboxPiece:
    """A part of the rows of comm's outbox from row `number` on: bytes `offset`.. of `total_bytes`.

    `outbox_id` is new whenever the outbox is opened: row numbers mean nothing beyond that.
    """

    t_s: float
    outbox_id: int
    number: int
    offset: int
    total_bytes: int
    data: bytes
    valid: bool = True
    recorder_id: int = 0  # whom it is for; 0: whoever answers first


@dataclass(frozen=True, slots=True)
class OutboxReceipt:
    """All rows before `number` are in the run database; of those sent from there on it holds `offset` bytes so far."""

    t_s: float
    outbox_id: int
    number: int
    offset: int = 0
    total_bytes: int = 0
    valid: bool = True
    recorder_id: int = 0


P = TypeVar("P")


@dataclass(frozen=True)
class Topic(Generic[P]):
    """One line of the table. `rate_hz` 0 = on event."""

    key: str  # <module>/<variable>, the module being the producer
    payload: type[P]
    rate_hz: float
    stance: Stance
    consumers: tuple[str, ...]
    flows: tuple[str, ...] = ()  # the specification's names
    note: str = ""

    @property
    def producer(self) -> str:
        return self.key.split("/")[0]

    @property
    def recorded(self) -> bool:
        """Every message of it belongs into the run database."""
        return "recorder" in self.consumers and self.stance is not Stance.BULK

    @property
    def is_command(self) -> bool:
        """A person's word to the robot: only the command center says it."""
        return self.producer == "command_center" and self.stance is Stance.COMMAND


_TOPICS: dict[str, Topic[object]] = {}


def _topic(
    key: str,
    payload: type[P],
    rate_hz: float,
    stance: Stance,
    consumers: str,
    flows: str = "",
    note: str = "",
) -> Topic[P]:
    topic = Topic(key, payload, rate_hz, stance, tuple(consumers.split()), tuple(flows.split()), note)
    _TOPICS[key] = topic  # type: ignore[assignment]
    return topic


OFFBOARD = "recorder visualizer command_center"
AT_ONCE = "and at once on change"

ODOMETRY = _topic(
    "bridge/odometry", Odometry, SENSOR_RATE_HZ, Stance.LATEST, "mmu planner recorder command_center", "lfc_sim_mmu"
)
RANGES = _topic("bridge/ranges", Ranges, SENSOR_RATE_HZ, Stance.LATEST, "mmu planner poi recorder", "lfc_sim_mmu")
DISTANCES = _topic("bridge/distances", Distances, SENSOR_RATE_HZ, Stance.LATEST, "planner recorder", "lfc_sim_pln")
CARRIER = _topic(
    "bridge/carrier",
    CarrierReport,
    SENSOR_RATE_HZ,
    Stance.LATEST,
    "planner comm recorder command_center",
    "lfc_pln_car",
    AT_ONCE,
)
DRIVE = _topic("planner/drive", DriveCommand, SENSOR_RATE_HZ, Stance.COMMAND, "bridge recorder", "lfc_pln_car", AT_ONCE)
POSE = _topic(
    "mmu/pose",
    PoseEstimate,
    POSE_RATE_HZ,
    Stance.LATEST,
    f"planner poi {OFFBOARD}",
    "lfc_mmu_poi lfc_mmu_pln lfc_mmu_cm",
)
MAP = _topic(
    "mmu/map",
    MapUpdate,
    MAP_RATE_MAX_HZ,
    Stance.STATE,
    f"planner poi {OFFBOARD}",
    "lfc_mmu_pln lfc_mmu_cm lfc_cm_vsl",
    "on change",
)
GRID = _topic(
    "mmu/grid", GridUpdate, MAP_RATE_MAX_HZ, Stance.STATE, "planner poi visualizer", "lfc_mmu_pln", "on change"
)
TRAJECTORY = _topic(
    "mmu/trajectory", Trajectory, 0.0, Stance.STATE, OFFBOARD, "lfc_mmu_cm", "when the past was corrected"
)
PLAN = _topic("planner/view", PlannerView, MAP_RATE_MAX_HZ, Stance.STATE, OFFBOARD, note="for people")
RETAKE = _topic("poi/request", PoiRequest, 0.0, Stance.COMMAND, "planner recorder", "lfc_poi_pln")
POI = _topic("poi/record", PointOfInterest, 0.0, Stance.EVENT, OFFBOARD, "lfc_poi_cm lfc_cm_vsl")
PERMIT = _topic("comm/permit", Permit, PERMIT_RATE_HZ, Stance.COMMAND, f"bridge planner poi {OFFBOARD}", note=AT_ONCE)
STOP = _topic("command_center/stop", StopRequest, 0.0, Stance.COMMAND, "bridge comm recorder", "lfc_cm_cc")
OPERATION = _topic("command_center/operation", OperatorCommand, 0.0, Stance.COMMAND, "planner comm recorder")
OUTBOX = _topic(
    "comm/outbox", OutboxPiece, 0.0, Stance.BULK, "recorder", note="what the robot has for the run database"
)
RECEIPT = _topic("recorder/receipt", OutboxReceipt, 0.0, Stance.LATEST, "comm", note="on progress, else every second")
CLOCK = _topic("clock/time", ClockTick, 0.0, Stance.COMMAND, "", note="only under `local --speed`")
CLOCK_ACK = _topic("clock/ack", ClockAck, 0.0, Stance.COMMAND, "", note="only under `local --speed`")

STATUS: dict[str, Topic[Status]] = {}
LOG: dict[str, Topic[LogLine]] = {}
for _module in ("sim", "car", "bridge", "mmu", "planner", "poi", "comm", "recorder", "visualizer", "command_center"):
    _flows = "lfc_cm_cc lfc_vsl_cc" if _module == "visualizer" else "lfc_cm_cc"
    STATUS[_module] = _topic(f"{_module}/status", Status, STATUS_RATE_HZ, Stance.LATEST, f"comm {OFFBOARD}", _flows)
    LOG[_module] = _topic(f"{_module}/log", LogLine, 0.0, Stance.EVENT, "recorder command_center", _flows)

TOPICS: tuple[Topic[object], ...] = tuple(_TOPICS.values())

# Flows that never touch the bus
INTERNAL_FLOWS: dict[str, str] = {"lfc_sim_car": "program memory of the Arduino: SIM and Carrier share one program"}

ON_ROBOT = ("bridge", "mmu", "planner", "comm", "poi")
ROBOT_SENDERS = ("sim", "car", *ON_ROBOT)  # SIM and Carrier speak through the bridge
ROBOT_RECORDED = tuple(t for t in TOPICS if t.recorded and t.producer in ROBOT_SENDERS)  # through the outbox
LAPTOP_RECORDED = tuple(t for t in TOPICS if t.recorded and t.producer not in ROBOT_SENDERS)


def topic_table() -> str:
    """The table of topics as the README shows it (Markdown)."""
    rows = ["| key | payload | rate | stance | consumers | flow |", "|---|---|---|---|---|---|"]
    shown: set[str] = set()
    for topic in TOPICS:
        key = f"*/{topic.key.split('/')[1]}" if topic.payload in (Status, LogLine) else topic.key
        if key in shown:
            continue
        shown.add(key)
        flows = ["lfc_cm_cc", "lfc_vsl_cc"] if topic.payload in (Status, LogLine) else list(topic.flows)
        rate = f"{topic.rate_hz:g} Hz" if topic.rate_hz else "on event"
        if topic.note:
            rate += f", {topic.note}"
        rows.append(
            f"| `{key}` | {topic.payload.__name__} | {rate} | {topic.stance.name} "
            f"| {', '.join(topic.consumers)} | {', '.join(flows)} |"
        )
    for flow, medium in INTERNAL_FLOWS.items():
        rows.append(f"| (none) | | | | {medium} | {flow} |")
    return "\n".join(rows)
