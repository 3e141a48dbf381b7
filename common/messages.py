"""The message table: one frozen dataclass per payload, one topic per variable, its producer and consumers.

Key on the bus: `<robot>/<module>/<variable>`. Every payload has `t_s`, when its content was measured on the sender's
clock; every output has `valid`, false when an input it rests on was not alive and valid. Sequence number and boot id
travel in the envelope (`codec.Envelope`), stamped by the bus. The codec holds every field to the bounds of its type
(`fields`). Add fields with a default, never reuse one, and rename one only with its former name (`Formerly`): old
recordings must load.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum
from functools import cached_property
from typing import Annotated, Generic, TypeVar

from common.constants import (
    BOARD_RATE_HZ,
    MAP_RATE_MAX_HZ,
    PERMIT_RATE_HZ,
    POSE_RATE_HZ,
    SENSOR_RATE_HZ,
    STATUS_RATE_HZ,
)
from common.fields import (
    GRID_CELLS_MAX,
    Blacklisted,
    Boot,
    BootIds,
    CellSize,
    Celsius,
    Challenge,
    CommandId,
    Count,
    CpuShare,
    Epoch,
    ErrorNumber,
    Formerly,
    GridBytes,
    GridSide,
    Identity,
    Load,
    MapPoints,
    MapStart,
    Marks,
    Metres,
    MetresPerSecond,
    Pace,
    PathPoints,
    Photo,
    Piece,
    PoiId,
    Poses,
    Pwm,
    Radians,
    RadiansPerSecond,
    Range,
    RowsBytes,
    Seconds,
    Sequences,
    Share,
    SonarAges,
    SonarRanges,
    Spread,
    SquareMetres,
    StopIds,
    StopNames,
    StopSources,
    Text,
    Ticks,
    Times,
    Topics,
    Volts,
    Word,
)
from common.modules import MODULES, OFFBOARD, ROBOT_SENDERS, publisher_of


class QosProfile(Enum):
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

    t_s: Seconds
    ticks_left: Ticks
    ticks_right: Ticks
    yaw_rad: Radians
    yaw_rate_rad_s: RadiansPerSecond
    x_m: Metres
    y_m: Metres
    speed_m_s: MetresPerSecond
    standing: bool  # wheels still, gyro bias being tracked
    bumper: bool
    cliff: bool
    session: Identity  # changes when the board restarts: ticks and yaw begin anew
    valid: bool = True
    yaw_by_walls_rad: Radians = 0.0  # that much of `yaw_rad` comes from walls, the rest from the gyro


@dataclass(frozen=True, slots=True)
class Ranges:
    """dist_Sensors_Array: five ranges from the ring's centre, NaN where nothing answered (no information)."""

    t_s: Seconds
    range_m: SonarRanges  # in the order of constants.SONAR_NAMES
    age_s: SonarAges  # how long before t_s each was measured
    valid: bool = True


@dataclass(frozen=True, slots=True)
class Distances:
    """dist_left, dist_right, dist_front: aggregated distances from the ring's centre to the walls, NaN where none."""

    t_s: Seconds
    left_m: Range
    right_m: Range
    front_m: Range
    valid: bool = True


@dataclass(frozen=True, slots=True)
class CarrierReport:
    """Completed and the state of the Carrier, ten times a second and at once on change."""

    t_s: Seconds
    state: CarrierState
    command_id: CommandId  # the drive command in force, 0 = none
    completed_id: CommandId  # the newest one completed
    aborted_id: CommandId  # the newest one given up
    speed_m_s: MetresPerSecond
    pwm_left: Pwm
    pwm_right: Pwm
    enabled: bool  # motor driver
    stop_latched: bool
    battery_v: Volts
    valid: bool = True
    boot: Boot = 0  # of the drive commands whose ids stand above
    board_epoch: Epoch = 0  # the newest stop epoch that the firmware knows
    bridge_epoch: Epoch = 0  # the newest that the bridge received in a permit, 0 = none since its start
    comm_life: Identity = 0  # of the newest permit that the bridge received
    stop_ids: StopIds = ()  # stops that the bridge holds and no permit has quoted yet
    stop_names: StopNames = ()  # their sources, in the same order
    button_pressed: bool = False  # the robot's own stop button, right now


@dataclass(frozen=True, slots=True)
class DriveCommand:
    """Desired_Speed and Desired_Angle: drive at `speed` along `yaw_rad` of SIM's own yaw. Newer replaces older."""

    t_s: Seconds
    command_id: CommandId
    speed: Speed
    yaw_rad: Radians
    valid: bool = True
    boot: Boot = 0  # of the planner: a restarted one counts its commands anew; 16 bits


@dataclass(frozen=True, slots=True)
class PoseEstimate:
    """Where the robot is in the map (frame: its start pose), with its uncertainty, tied to SIM's yaw at that moment."""

    t_s: Seconds
    x_m: Metres
    y_m: Metres
    heading_rad: Radians
    yaw_rad: Radians  # SIM's yaw at t_s: heading_rad - yaw_rad turns a map heading into a drive command
    sd_xy_m: Spread
    sd_heading_rad: Spread
    map_revision: Count
    valid: bool = True


@dataclass(frozen=True, slots=True)
class MapUpdate:
    """Wall points. `start` 0 begins the map anew (the past was corrected); else the points go on at index `start`."""

    t_s: Seconds
    revision: Count
    start: MapStart
    points_m: MapPoints
    inferred: Marks  # 1 where a wall was concluded, not echoed
    valid: bool = True


@dataclass(frozen=True, slots=True)
class GridUpdate:
    """The occupancy grid for driving: 0 unknown, 1 free, 2 wall; zlib over the row-major cells."""

    t_s: Seconds
    revision: Count
    origin_x_m: Metres  # outer corner of cell (0, 0)
    origin_y_m: Metres
    cell_m: CellSize
    rows: GridSide  # along y
    columns: GridSide  # along x
    cells_zlib: GridBytes
    valid: bool = True

    def __post_init__(self) -> None:
        if self.rows * self.columns > GRID_CELLS_MAX:
            raise ValueError(f"{self.rows} rows of {self.columns} cells are too many")


@dataclass(frozen=True, slots=True)
class Trajectory:
    """The smoothed path as it is believed now: times and poses of the key frames."""

    t_s: Seconds
    times_s: Times
    poses: Poses  # x, y, heading
    valid: bool = True


class Outcome(Enum):
    """How the newest order to the Planner ended (onboard/planner/mission/table.py)."""

    NONE = "none"  # not ended, or none was given
    FINISHED = "finished"  # everything that can be reached is explored, and the robot is home
    HOME = "home"  # sent home before that, and there
    ARRIVED = "arrived"  # at the place of a goto
    GAVE_UP = "gave up"  # no path led there for too long
    NEEDS_HELP = "needs help"  # no way home for too long: somebody has to come
    STOPPED = "stopped"  # a latched stop holds it; it goes on after release and resume

    @property
    def ends_mission(self) -> bool:
        """Is the run over, as far as the robot is concerned?"""
        return self in (Outcome.FINISHED, Outcome.HOME, Outcome.GAVE_UP, Outcome.NEEDS_HELP)

    @property
    def exit_code(self) -> int:
        """Of a run that ended like this."""
        return {Outcome.FINISHED: 0, Outcome.HOME: 0, Outcome.NEEDS_HELP: 3}.get(self, 1)


@dataclass(frozen=True, slots=True)
class PlannerView:
    """The Planner's state, for people: mode, planned path, length of the list of side halls."""

    t_s: Seconds
    mode: Word
    detail: Text
    path_m: PathPoints
    halls_open: Count
    area_m2: SquareMetres
    outcome: Outcome = Outcome.NONE
    valid: bool = True
    command_id: CommandId = 0  # of the newest OperatorCommand that was answered
    refused: bool = False  # that command does nothing
    note: Text = ""  # what its sender should read about it
    paused: bool = False  # by an operator
    blacklisted: Blacklisted = ()  # places that the newest exploration left out, each with its reason


class PoiCommand(Enum):
    STOP = "STOP"
    CONTINUE = "CONTINUE"
    REVERSE = "REVERSE"
    GOTO = "GOTO"


@dataclass(frozen=True, slots=True)
class PoiRequest:
    """Planner_Command: hold, go on, go back, or stand at a pose for another photo."""

    t_s: Seconds
    command: PoiCommand
    x_m: Metres = 0.0
    y_m: Metres = 0.0
    heading_rad: Radians = 0.0
    valid: bool = True


@dataclass(frozen=True, slots=True)
class PointOfInterest:
    """Current_POI: one record per door (decision 28)."""

    t_s: Seconds
    poi_id: PoiId
    name: Word
    description: Word
    x_m: Metres
    y_m: Metres
    number: Word  # in its shown form; found by `room_number.key_of`
    room_type: Word
    confidence: Share
    state: Word
    photo_jpeg: Photo = b""
    valid: bool = True


@dataclass(frozen=True, slots=True)
class Permit:
    """May the robot move? Granted only while every on-robot module is alive, fresh, valid and running, and the
    newest latched stop was released and followed by a resume."""

    t_s: Seconds
    granted: bool
    reason: Text
    stop_sources: StopSources = ()  # who holds the latched stop
    valid: bool = True
    challenge: Challenge = b""  # to sign commands over; empty where none need be
    stop_epoch: Epoch = 0  # grows with every latched stop; 0: comm does not know it yet
    stop_ids: StopIds = ()  # the newest stops that are latched in this epoch
    resumed: bool = True  # a resume was given since this epoch's stop was released
    life: Identity = 0  # of comm: another number after each restart


@dataclass(frozen=True, slots=True)
class StopRequest:
    """e-Stop command: latch the software stop, or release the epoch it names. Repeated until the robot confirms."""

    t_s: Seconds
    source: Word
    latched: bool
    valid: bool = True
    stop_id: Identity = 0  # of this press, drawn at random; its repeats carry the same
    epoch: Epoch = 0  # which stop is released: the `stop_epoch` that the person saw


class Operation(Enum):
    START = "start"
    PAUSE = "pause"
    RESUME = "resume"
    HOME = "home"
    GOTO = "goto"


@dataclass(frozen=True, slots=True)
class OperatorCommand:
    """An operator's command to the mission."""

    t_s: Seconds
    operation: Operation
    x_m: Metres = 0.0
    y_m: Metres = 0.0
    valid: bool = True
    command_id: CommandId = 0  # repeated with the same one until PlannerView acknowledges it; 0 = not acknowledged
    epoch: Epoch = 0  # of a resume: the stop epoch after which the robot may go on


@dataclass(frozen=True, slots=True)
class Status:
    """State, error code and memory of a module (CC_MR_03), ten times a second."""

    t_s: Seconds
    state: Word
    error_code: ErrorNumber
    memory_kb: Count
    ready: bool
    heartbeat_count: Annotated[Count, Formerly("beats")]  # passes of the module's own loop
    detail: Text = ""
    valid: bool = True
    cpu_share: CpuShare = 0.0  # of its process, over the last second; 0 where nobody measures it


@dataclass(frozen=True, slots=True)
class BoardState:
    """How a computer of the robot is: what a person looks at before trusting it with a long run."""

    t_s: Seconds
    name: Word  # as the computer calls itself
    release: Word  # of the programs, as `deploy` named it
    uptime_s: Seconds
    load: Load  # mean of a minute
    temperature_c: Celsius  # of its hottest part
    disk_free_mb: Count  # where it keeps what must outlive a restart
    wall_s: Seconds  # since 1970 by its own clock: the laptop judges by its own how far off that is
    valid: bool = True


@dataclass(frozen=True, slots=True)
class LogLine:
    t_s: Seconds
    level: Word
    text: Text
    valid: bool = True


@dataclass(frozen=True, slots=True)
class ClockTick:
    """Simulated time, under `local --speed N` only, and what was published before it: newest message of each topic."""

    t_s: Seconds
    speed: Pace
    topics: Topics = ()
    boot_ids: BootIds = ()
    sequences: Sequences = ()
    valid: bool = True


@dataclass(frozen=True, slots=True)
class ClockAck:
    """A process has nothing to do before `t_s` of simulated time: the clock may go there, and a little further.

    With it, what the process published since its last ClockAck.
    """

    t_s: Seconds
    module: Word
    topics: Topics = ()
    boot_ids: BootIds = ()
    sequences: Sequences = ()
    valid: bool = True


@dataclass(frozen=True, slots=True)
class OutboxPiece:
    """A part of the rows of comm's outbox from row `number` on: bytes `offset`.. of `total_bytes`.

    `outbox_id` is new whenever the outbox is opened: row numbers mean nothing beyond that.
    """

    t_s: Seconds
    outbox_id: Identity
    number: Count
    offset: RowsBytes
    total_bytes: RowsBytes
    data: Piece
    valid: bool = True
    recorder_id: Identity = 0  # the recorder that it is for; 0: the first that replies


@dataclass(frozen=True, slots=True)
class OutboxReceipt:
    """All rows before `number` are in the run database; of those sent from there on it holds `offset` bytes so far."""

    t_s: Seconds
    outbox_id: Identity
    number: Count
    offset: RowsBytes = 0
    total_bytes: RowsBytes = 0
    valid: bool = True
    recorder_id: Identity = 0


P = TypeVar("P")


@dataclass(frozen=True)
class Topic(Generic[P]):
    """One line of the table. `rate_hz` 0 = on event."""

    key: str  # <module>/<variable>, the module being the producer
    payload: type[P]
    rate_hz: float
    qos: QosProfile
    consumers: tuple[str, ...]
    flows: tuple[str, ...] = ()  # the specification's names
    note: str = ""

    @property
    def producer(self) -> str:
        return self.key.split("/")[0]

    @cached_property
    def bundle_key(self) -> str:
        """Where its messages travel, together with others of the same step; empty where each travels by itself."""
        periodic = self.rate_hz > 0.0 and self.qos in (QosProfile.LATEST, QosProfile.COMMAND)
        return f"{publisher_of(self.producer)}/bundle" if periodic else ""

    @property
    def recorded(self) -> bool:
        """Every message of it belongs into the run database."""
        return "recorder" in self.consumers and self.qos is not QosProfile.BULK

    @property
    def is_command(self) -> bool:
        """A person's command to the robot: only the command center publishes it."""
        return self.producer == "command_center" and self.qos is QosProfile.COMMAND


_TOPICS: dict[str, Topic[object]] = {}


def _topic(
    key: str,
    payload: type[P],
    rate_hz: float,
    qos: QosProfile,
    consumers: str,
    flows: str = "",
    note: str = "",
) -> Topic[P]:
    topic = Topic(key, payload, rate_hz, qos, tuple(consumers.split()), tuple(flows.split()), note)
    _TOPICS[key] = topic  # type: ignore[assignment]
    return topic


PEOPLE = " ".join(OFFBOARD)  # what stands on the laptop shows and stores it for people
AT_ONCE = "and at once on change"

ODOMETRY = _topic(
    "bridge/odometry", Odometry, SENSOR_RATE_HZ, QosProfile.LATEST, "mmu planner recorder command_center", "lfc_sim_mmu"
)
RANGES = _topic("bridge/ranges", Ranges, SENSOR_RATE_HZ, QosProfile.LATEST, "mmu planner poi recorder", "lfc_sim_mmu")
DISTANCES = _topic("bridge/distances", Distances, SENSOR_RATE_HZ, QosProfile.LATEST, "planner recorder", "lfc_sim_pln")
CARRIER = _topic(
    "bridge/carrier",
    CarrierReport,
    SENSOR_RATE_HZ,
    QosProfile.LATEST,
    "planner comm recorder command_center",
    "lfc_pln_car",
    AT_ONCE,
)
DRIVE = _topic(
    "planner/drive", DriveCommand, SENSOR_RATE_HZ, QosProfile.COMMAND, "bridge recorder", "lfc_pln_car", AT_ONCE
)
POSE = _topic(
    "mmu/pose",
    PoseEstimate,
    POSE_RATE_HZ,
    QosProfile.LATEST,
    f"planner poi {PEOPLE}",
    "lfc_mmu_poi lfc_mmu_pln lfc_mmu_cm",
)
MAP = _topic(
    "mmu/map",
    MapUpdate,
    MAP_RATE_MAX_HZ,
    QosProfile.STATE,
    f"planner poi {PEOPLE}",
    "lfc_mmu_pln lfc_mmu_cm lfc_cm_vsl",
    "on change",
)
GRID = _topic(
    "mmu/grid", GridUpdate, MAP_RATE_MAX_HZ, QosProfile.STATE, "planner poi visualizer", "lfc_mmu_pln", "on change"
)
TRAJECTORY = _topic(
    "mmu/trajectory", Trajectory, 0.0, QosProfile.STATE, PEOPLE, "lfc_mmu_cm", "when the past was corrected"
)
PLAN = _topic("planner/view", PlannerView, MAP_RATE_MAX_HZ, QosProfile.STATE, PEOPLE, note="for people")
RETAKE = _topic("poi/request", PoiRequest, 0.0, QosProfile.COMMAND, "planner recorder", "lfc_poi_pln")
POI = _topic("poi/record", PointOfInterest, 0.0, QosProfile.EVENT, PEOPLE, "lfc_poi_cm lfc_cm_vsl")
PERMIT = _topic("comm/permit", Permit, PERMIT_RATE_HZ, QosProfile.COMMAND, f"bridge planner poi {PEOPLE}", note=AT_ONCE)
STOP = _topic("command_center/stop", StopRequest, 0.0, QosProfile.COMMAND, "bridge comm recorder", "lfc_cm_cc")
OPERATION = _topic("command_center/operation", OperatorCommand, 0.0, QosProfile.COMMAND, "planner comm recorder")
OUTBOX = _topic(
    "comm/outbox", OutboxPiece, 0.0, QosProfile.BULK, "recorder", note="what the robot has for the run database"
)
RECEIPT = _topic(
    "recorder/receipt", OutboxReceipt, 0.0, QosProfile.LATEST, "comm", note="on progress, else every second"
)
CLOCK = _topic("clock/time", ClockTick, 0.0, QosProfile.COMMAND, "", note="only under `local --speed`")
CLOCK_ACK = _topic("clock/ack", ClockAck, 0.0, QosProfile.COMMAND, "", note="only under `local --speed`")

# Who reports for the board that it runs on
BOARD: dict[str, Topic[BoardState]] = {
    module: _topic(f"{module}/board", BoardState, BOARD_RATE_HZ, QosProfile.LATEST, "command_center")
    for module in ("comm", "poi")
}
STATUS: dict[str, Topic[Status]] = {}
LOG: dict[str, Topic[LogLine]] = {}
for _module in (module.name for module in MODULES):
    _flows = "lfc_cm_cc lfc_vsl_cc" if _module == "visualizer" else "lfc_cm_cc"
    STATUS[_module] = _topic(f"{_module}/status", Status, STATUS_RATE_HZ, QosProfile.LATEST, f"comm {PEOPLE}", _flows)
    LOG[_module] = _topic(f"{_module}/log", LogLine, 0.0, QosProfile.EVENT, "recorder command_center", _flows)

TOPICS: tuple[Topic[object], ...] = tuple(_TOPICS.values())

# Flows that never touch the bus
INTERNAL_FLOWS: dict[str, str] = {"lfc_sim_car": "program memory of the Arduino: SIM and Carrier share one program"}

ROBOT_RECORDED = tuple(t for t in TOPICS if t.recorded and t.producer in ROBOT_SENDERS)  # through the outbox
LAPTOP_RECORDED = tuple(t for t in TOPICS if t.recorded and t.producer not in ROBOT_SENDERS)
