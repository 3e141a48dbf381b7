"""The map on disk: it outlives a restart of the process, and another run can find its way in it.

Written whole under another name, then renamed: a reader never meets half of one. Saved at every closure and at least
every 30 s.
"""

from __future__ import annotations

import logging
import os
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from common.geometry import FloatArray, Pose2
from onboard.mmu.map.keyframes import KeyFrame, LastSeen

MAP_NAME = "map.npz"  # in the log folder of mmu
SAVE_EVERY_S = 30.0
FORMAT = 1

_log = logging.getLogger("mmu")


@dataclass(frozen=True, slots=True)
class SavedMap:
    """Key frames with their poses (K, 3) in the map, what was seen from them, and where the robot was last."""

    times_s: FloatArray  # (K,)
    poses: FloatArray
    ways_m: FloatArray  # (K,)
    echoes: FloatArray  # (N, 6) as `FrameStore` keeps them
    rays: FloatArray
    last: LastSeen | None = None

    def frames(self) -> tuple[KeyFrame, ...]:
        """As key frames whose odometry is the map itself."""
        travel_m = turned_rad = 0.0
        frames: list[KeyFrame] = []
        for t_s, way_m, row in zip(self.times_s.tolist(), self.ways_m.tolist(), self.poses, strict=True):
            pose = Pose2.from_array(row)
            if frames:
                relative = frames[-1].odom.between(pose)
                travel_m += frames[-1].odom.distance_m(pose)
                turned_rad += relative.heading_rad
            frames.append(KeyFrame(t_s, pose, travel_m, way_m, turned_rad, 0.0))
        return tuple(frames)


def try_save(file: Path, saved: SavedMap) -> None:
    """A disk that refuses must not keep the mapping from going on."""
    try:
        save_map(file, saved)
    except OSError as error:
        _log.warning("map not saved file=%s error=%s", file, error)


def save_map(file: Path, saved: SavedMap) -> None:
    """Replaces the file; raises OSError."""
    part = file.with_name(f".{file.name}.part")
    last = saved.last
    with part.open("wb") as stream:
        np.savez(
            stream,
            format=FORMAT,
            times_s=saved.times_s,
            poses=saved.poses,
            ways_m=saved.ways_m,
            echoes=saved.echoes.astype(np.float32),
            rays=saved.rays.astype(np.float32),
            last=np.array([] if last is None else [last.session, *last.board.as_array(), *last.pose.as_array()]),
        )
        stream.flush()
        os.fsync(stream.fileno())
    part.replace(file)


def load_map(file: Path) -> SavedMap | None:
    """The map in a file; None, with a line in the log, where there is none that can be used."""
    try:
        with np.load(file, allow_pickle=False) as content:
            if int(content["format"]) != FORMAT:
                raise ValueError(f"format {int(content['format'])}, expected {FORMAT}")
            arrays = {name: np.asarray(content[name], np.float64) for name in content.files}
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, BadZipFile, EOFError) as error:
        _log.warning("map not readable, begins anew file=%s error=%s", file, error)
        return None
    row = arrays["last"]
    last = LastSeen(int(row[0]), Pose2.from_array(row[1:4]), Pose2.from_array(row[4:7])) if len(row) else None
    return SavedMap(arrays["times_s"], arrays["poses"], arrays["ways_m"], arrays["echoes"], arrays["rays"], last)
