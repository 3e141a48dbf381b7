"""A module that talks as the robot's modules do, and tells at its end what it said: `talker.py NAME --config FILE`.

"mmu" says pose and status ten times a second and now and then a piece of map; "poi" a status, now and then a finding
with a photo. In `<name>.said` of its log folder: [topic, boot id, newest sequence number] of everything it published;
in `<name>.map.npy` the wall points.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from common.bus import Bus
from common.config import Config
from common.messages.mapping import MapUpdate, PoseEstimate
from common.messages.points_of_interest import PointOfInterest
from common.messages.topics import MAP, POI, POSE
from common.process import argument_parser, run
from common.status import StatusReporter
from common.zenoh_bus import ZenohBus

PHOTO_BYTES = 80_000
CORRECTED_EVERY = 20  # wall points


class Talker:
    period_s = 0.1
    wakes_on = ()

    def __init__(self, name: str, folder: Path) -> None:
        self.name = name
        self._folder = folder
        self._status = StatusReporter(name)
        self._steps = 0
        self._map_m: list[tuple[float, float]] = []
        self._bus: ZenohBus | None = None

    def step(self, bus: Bus, now_s: float) -> None:
        assert isinstance(bus, ZenohBus)
        self._bus = bus
        self._status.report(bus, now_s, state="RUN", ready=True)
        if self.name == "mmu":
            bus.publish(POSE, PoseEstimate(now_s, 0.1 * self._steps, 0.0, 0.0, 0.0, 0.1, 0.1, 1))
            if self._steps % 5 == 0:
                self._tell_map(bus, now_s)
        elif self._steps % 10 == 0:
            number = self._steps // 10
            photo = bytes([number % 256]) * PHOTO_BYTES
            bus.publish(
                POI, PointOfInterest(now_s, number, "Door", str(number), 1.0, 2.0, str(number), "", 1.0, "read", photo)
            )
        self._steps += 1

    def _tell_map(self, bus: Bus, now_s: float) -> None:
        """One point more; now and then the whole map is corrected."""
        start = len(self._map_m)
        revision = 1 + start // CORRECTED_EVERY
        if start % CORRECTED_EVERY == 0:
            start, self._map_m = 0, [(x_m, float(revision)) for x_m, _ in self._map_m]
        self._map_m.append((float(self._steps), float(revision)))
        points_m = np.array(self._map_m[start:], np.float32)
        bus.publish(MAP, MapUpdate(now_s, revision, start, points_m, np.zeros(len(points_m), np.uint8)))

    def close(self) -> None:
        if self._bus is None:
            return
        np.save(self._folder / f"{self.name}.map.npy", np.array(self._map_m, np.float32).reshape(-1, 2))
        said = [[*source, newest] for source, newest in self._bus.published().items()]
        (self._folder / f"{self.name}.said").write_text(json.dumps(said), encoding="utf-8")


def make(_: Config, arguments: argparse.Namespace) -> Talker:
    return Talker(arguments.name, arguments.log_dir)


if __name__ == "__main__":
    parser = argument_parser("talker")
    parser.add_argument("name")
    sys.exit(run(sys.argv[1], make, parser=parser))
