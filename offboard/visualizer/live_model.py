"""What the page shows, as values: the newest of every message, the map so far, the trail, the points of interest.

Messages of the bus (or of a recording that is played back) and their arrival times -> `LiveModel`. Pure: no clock, no
thread. `tokens` shows what has changed: a client that has seen a channel's token has seen all of it.
"""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass
from itertools import count
from math import hypot, inf
from typing import Any

import numpy as np
import numpy.typing as npt

from common.door_names import DoorNote, all_notes
from common.geometry import FloatArray, Points
from common.messages.health import Status
from common.messages.mapping import GridUpdate, MapUpdate, PoseEstimate, Trajectory
from common.messages.mission import PlannerView
from common.messages.motion import CarrierReport, Ranges
from common.messages.points_of_interest import DoorStatements, PointOfInterest
from common.messages.stop import Permit
from common.messages.topics import (
    CARRIER,
    DOOR_NOTES,
    GRID,
    MAP,
    PERMIT,
    PLAN,
    POI,
    POSE,
    RANGES,
    TRAJECTORY,
    ZONES,
    Topic,
)
from common.mission_state import mission_state
from common.modules import ON_ROBOT
from common.zones import Zone, zones_of
from offboard.operate import alerts
from offboard.operate.bus_operator import OperatorView
from offboard.runs.map_assembly import MapAssembly
from offboard.runs.run_folder import MapData, on_floor
from offboard.visualizer.poi_store import PoiRecord, record_of, with_notes
from offboard.visualizer.vitals import Vitals

TRAIL_STEP_M = 0.05
TRAIL_MAX = 50_000  # poses since the smoothed path ends, which is sent every few seconds
PHOTO_BYTES_MAX = 16_000_000  # of photos that the store has not taken yet; the newest count

Token = tuple[int, int]


@dataclass(frozen=True, slots=True)
class ShownRun:
    """What a page says of the run: `name` for `indoor-mapping view`, `recorded` when it was, empty while it goes on."""

    name: str = ""
    recorded: str = ""


NO_RUN = ShownRun()


class LiveModel:
    """`take` every message; read the fields.

    Times of arrival (seconds, the receiver's clock) by name: "pose", "ranges", "robot" for anything from the robot, and
    the modules' own names for their statuses.
    """

    def __init__(self) -> None:
        self.pose: PoseEstimate | None = None
        self.plan: PlannerView | None = None
        self.permit: Permit | None = None
        self.ranges: Ranges | None = None
        self.vitals = Vitals()
        self.alerts: dict[str, str] = {}  # sentence by what it is about
        self.operator: OperatorView | None = None
        self.playback: object = None  # of a recorded run: where the page is in it, and moments to look at
        self.moments: tuple[object, ...] = ()
        self.log: tuple[object, ...] = ()
        self.grid: GridUpdate | None = None
        self.zones: tuple[Zone, ...] = ()
        self.statuses: dict[str, Status] = {}
        self.pois: dict[int, PoiRecord] = {}
        self.notes: tuple[DoorNote, ...] | None = None  # of doors, by people; None: as the store has it
        self.photos: dict[int, bytes] = {}  # until the store has them
        self.points_m: npt.NDArray[np.float32] = np.empty((0, 2), np.float32)
        self.inferred: npt.NDArray[np.uint8] = np.empty(0, np.uint8)
        self.tokens: dict[str, Token] = {"map": (0, 0), "pois": (0, 0), "modules": (0, 0)}
        self.arrived_s: dict[str, float] = {}
        self._versions = count(1)
        self._assembly = MapAssembly()
        self._smoothed: FloatArray = np.empty((0, 3))
        # t, x, y, heading since the smoothed path ends
        self._since: deque[tuple[float, float, float, float]] = deque(maxlen=TRAIL_MAX)
        self._takers: dict[str, Callable[[Any], None]] = {
            MAP.key: self._take_map,
            TRAJECTORY.key: self._take_trajectory,
            POI.key: self._take_poi,
            PLAN.key: self._take_plan,
            PERMIT.key: self._take_permit,
            DOOR_NOTES.key: self._take_notes,
            ZONES.key: lambda zones: self._replace("zones", zones_of(zones)),
            GRID.key: lambda grid: self._replace("grid", grid),
            CARRIER.key: self._take_carrier,
        }

    def take(self, topic: Topic[Any], message: Any, arrived_s: float) -> None:
        """A message that arrived at `arrived_s`."""
        if topic.producer in ON_ROBOT:
            self.arrived_s["robot"] = arrived_s
        if isinstance(message, Status):
            self._take_status(topic.producer, message, arrived_s)
        elif topic is POSE:
            self._take_pose(message, arrived_s)
        elif topic is RANGES:
            self.arrived_s["ranges"] = arrived_s
            self._replace("ranges", message)
        else:
            self._takers[topic.key](message)

    def show(self, channel: str, value: object) -> None:
        """What comes from no module: `operator`, `playback`, `moments` or `log`."""
        self._replace(channel, value)

    def begin_anew(self) -> None:
        """Map, path and points of interest are those that come from now on."""
        epoch, _ = self.tokens["map"]
        self._assembly = MapAssembly()
        self.points_m, self.inferred = self._assembly.known()
        self.tokens["map"] = epoch + 1, 0
        self._smoothed = np.empty((0, 3))
        self._since.clear()
        self.pois.clear()
        self._changed("pois")

    def path_changed(self) -> None:
        """More came at once than one pose."""
        self._changed("trail")

    def take_stored(self, records: Iterable[PoiRecord]) -> None:
        """Points of interest as the recorder has kept them; what came live and is newer stays."""
        for record in records:
            known = self.pois.get(record.poi_id)
            if known is not None and known.t_s > record.t_s:
                continue
            record = self._noted(record)
            if known != record:
                self.pois[record.poi_id] = record
                self._changed("pois")
            if record.has_photo:
                self.photos.pop(record.poi_id, None)

    def trail(self) -> FloatArray:
        """The path driven, (K, 3) x, y, heading: smoothed as far as that reaches, then as it was driven."""
        driven = np.array([pose[1:] for pose in self._since]).reshape(-1, 3)
        return np.concatenate([self._smoothed, driven])

    def map_data(self) -> MapData:
        """All of it that can be on one floor, as the exports take it."""
        near = on_floor(self.points_m)
        records = list(self.pois.values())
        pois = [dataclasses.asdict(records[k]) for k in np.flatnonzero(on_floor(_places_m(records)))]
        trail = self.trail()
        trail = trail[on_floor(trail[:, :2])]
        return MapData(self.points_m[near].astype(np.float64), self.inferred[near], trail, pois, self.zones)

    def drawn(self) -> Hashable:
        """Another value whenever `map_data` is another."""
        return *(self.tokens.get(channel) for channel in ("map", "pois", "trail", "zones")), len(self._since)

    def _changed(self, channel: str) -> None:
        self.tokens[channel] = (next(self._versions), 0)

    def _replace(self, channel: str, message: Any) -> None:
        setattr(self, channel, message)
        self._changed(channel)

    def _take_plan(self, plan: PlannerView) -> None:
        self._replace("plan", plan)
        self._changed("mission")
        self.vitals.take_plan(plan)
        self._look_for_alerts()

    def _take_carrier(self, carrier: CarrierReport) -> None:
        self.vitals.take_carrier(carrier)
        self._changed("vitals")

    def _look_for_alerts(self) -> None:
        found = alerts.reasons(self.plan, [(module, status.error_code) for module, status in self.statuses.items()])
        if found != self.alerts or "alerts" not in self.tokens:
            self._replace("alerts", found)

    def _take_permit(self, permit: Permit) -> None:
        """It comes many times a second, and mostly brings nothing new."""
        old, self.permit = self.permit, permit
        if mission_state(self.plan, old) != mission_state(self.plan, permit):
            self._changed("mission")

    def _take_status(self, module: str, status: Status, arrived_s: float) -> None:
        """Ten a second of each, of which nearly all repeat the one before."""
        self.arrived_s[module] = arrived_s
        before = self.statuses.get(module)
        self.statuses[module] = status
        if before is None or _shown(before) != _shown(status):
            self._changed("modules")
            if self.plan is not None:  # what is so from the beginning on is no news, and begins with the plan
                self._look_for_alerts()
        if self.vitals.take_status(module, status, arrived_s):
            self._changed("health")

    def _take_pose(self, pose: PoseEstimate, arrived_s: float) -> None:
        self.arrived_s["pose"] = arrived_s
        self.vitals.take_pose(pose, arrived_s)
        self._changed("vitals")
        # Counted, so that the number of poses that a slow client skipped is known
        self.tokens["pose"] = (self.tokens.get("pose", (0, 0))[0] + 1, 0)
        self.tokens.setdefault("trail", (0, 0))
        self.pose = pose
        place = (pose.x_m, pose.y_m)
        if not self._since or hypot(place[0] - self._since[-1][1], place[1] - self._since[-1][2]) >= TRAIL_STEP_M:
            self._since.append((pose.t_s, *place, pose.heading_rad))

    def _take_map(self, update: MapUpdate) -> None:
        epoch, _ = self.tokens["map"]
        if update.start < len(self._assembly):
            epoch += 1
        self._assembly.add(update)
        self.points_m, self.inferred = self._assembly.known()
        self.tokens["map"] = (epoch, len(self.points_m))

    def _take_trajectory(self, trajectory: Trajectory) -> None:
        self._smoothed = np.asarray(trajectory.poses, np.float64)
        times_s = np.asarray(trajectory.times_s)
        until_s = float(times_s[-1]) if len(times_s) else -inf
        self._since = deque((pose for pose in self._since if pose[0] > until_s), TRAIL_MAX)
        self._changed("trail")

    def _take_poi(self, poi: PointOfInterest) -> None:
        record = record_of(poi)
        known = self.pois.get(poi.poi_id)
        if poi.photo_jpeg:
            self._keep_photo(poi.poi_id, poi.photo_jpeg)
        elif known is not None and known.has_photo:
            record = dataclasses.replace(record, has_photo=True)
        self.pois[poi.poi_id] = self._noted(record)
        self._changed("pois")

    def _take_notes(self, message: DoorStatements) -> None:
        self.notes = all_notes(message)
        self.pois = {poi_id: self._noted(record) for poi_id, record in self.pois.items()}
        self._changed("pois")

    def _noted(self, record: PoiRecord) -> PoiRecord:
        return record if self.notes is None else with_notes(record, self.notes)

    def _keep_photo(self, poi_id: int, photo: bytes) -> None:
        self.photos.pop(poi_id, None)
        self.photos[poi_id] = photo
        while len(self.photos) > 1 and sum(map(len, self.photos.values())) > PHOTO_BYTES_MAX:
            del self.photos[next(iter(self.photos))]


def _shown(status: Status) -> tuple[object, ...]:
    return status.state, status.error_code, status.ready, status.memory_kb, status.detail


def _places_m(records: Iterable[PoiRecord]) -> Points:
    return np.array([(record.x_m, record.y_m) for record in records], np.float64).reshape(-1, 2)
