"""The map on disk: it outlives a restart of the process, and another run can localise in it as its prior map.

Written whole under another name, then renamed, so that no reader gets half of one. Saved at every loop closure and at
least every 30 s.
"""

from __future__ import annotations

import logging
import os
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from common.geometry import FloatArray, Pose2
from onboard.mmu.map.keyframes import Keyframe, LastSeen

MAP_NAME = "map.npz"  # in the log folder of mmu
SAVE_EVERY_S = 30.0
FORMAT = 2

_log = logging.getLogger("mmu")


@dataclass(frozen=True, slots=True)
class SavedMap:
    """Keyframes with their poses (K, 3) in the map, what was observed from them, and where the robot was last."""

    times_s: FloatArray  # (K,)
    poses: FloatArray
    paths_m: FloatArray  # (K,)
    echoes: FloatArray  # (N, 6) as `ObservationStore` keeps them
    rays: FloatArray
    last: LastSeen | None = None

    def keyframes(self) -> tuple[Keyframe, ...]:
        """As keyframes whose odometry is the map itself."""
        travel_m = turned_rad = 0.0
        keyframes: list[Keyframe] = []
        for t_s, path_m, row in zip(self.times_s.tolist(), self.paths_m.tolist(), self.poses, strict=True):
            pose = Pose2.from_array(row)
            if keyframes:
                relative = keyframes[-1].odom.between(pose)
                travel_m += keyframes[-1].odom.distance_m(pose)
                turned_rad += relative.heading_rad
            keyframes.append(Keyframe(t_s, pose, travel_m, path_m, turned_rad, 0.0))
        return tuple(keyframes)


def try_save(file: Path, saved: SavedMap) -> None:
    """A disk that refuses must not stop the mapping."""
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
            paths_m=saved.paths_m,
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
        _log.warning("map not readable, a new one begins file=%s error=%s", file, error)
        return None
    row = arrays["last"]
    last = LastSeen(int(row[0]), Pose2.from_array(row[1:4]), Pose2.from_array(row[4:7])) if len(row) else None
    return SavedMap(arrays["times_s"], arrays["poses"], arrays["paths_m"], arrays["echoes"], arrays["rays"], last)
