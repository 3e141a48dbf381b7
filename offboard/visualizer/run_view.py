"""A recorded run on the page: run folder -> `Feed`, served until somebody ends it.

For the verb `view`, and for `local` after its end. Map, path and doors are those of the files, as in every export; what
the robot and its modules reported last comes from the run database, where there is one.
"""

from __future__ import annotations

import logging
import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np

from common.config import VisualizerSection
from common.errors import StartError, sentence
from common.fields import GRID_CELLS_MAX
from common.messages.mapping import GridUpdate, MapUpdate, PoseEstimate, Trajectory
from common.messages.topics import CARRIER, GRID, MAP, PERMIT, PLAN, POSE, STATUS, TRAJECTORY, ZONES, Topic
from common.zones import message_of
from offboard.export import occupancy_image
from offboard.runs.run_database import RunReader
from offboard.runs.run_folder import DATABASE_NAME, RunFolderError, files_of_run, read_map, read_path
from offboard.runs.run_list import RunLine, read_run
from offboard.visualizer.feed import Feed
from offboard.visualizer.feed_site import FeedSite
from offboard.visualizer.live_model import ShownRun
from offboard.visualizer.playback import Playback
from offboard.visualizer.poi_store import RunFolderPois
from offboard.visualizer.server import PageServer, Site

_POLL_S = 0.2
_LAST: tuple[Topic[Any], ...] = (POSE, PLAN, PERMIT, CARRIER, *STATUS.values())

_log = logging.getLogger("view")


@dataclass(frozen=True, slots=True)
class RecordedRun:
    """Its end, and where it can be played: its database."""

    feed: Feed
    playback: Playback | None


def recorded_run(run_dir: Path) -> RecordedRun:
    """The run as it was at its end. Raises RunFolderError where there is none, or a file of it is damaged."""
    if not files_of_run(run_dir):
        raise RunFolderError(f"There is no recorded run at {run_dir}; `indoor-mapping runs` lists the runs.")
    clock = _RunClock()
    feed = Feed(RunFolderPois(run_dir), clock, ShownRun(str(run_dir), _when(read_run(run_dir))))
    _take_files(feed, run_dir)
    if (run_dir / DATABASE_NAME).exists():
        _take_last_messages(feed, clock, run_dir)
        return RecordedRun(feed, Playback(run_dir, feed))
    return RecordedRun(feed, None)


def serve(
    run: RecordedRun,
    page: VisualizerSection,
    stop: Event,
    on_address: Callable[[str], None],
    unwatched_s: float = inf,
) -> None:
    """Serves the run's page, as `serve_site`."""
    name = Path(run.feed.run.name).resolve().name
    serve_site(FeedSite(run.feed, name, playback=run.playback), page, stop, on_address, unwatched_s)


def serve_site(
    site: Site, page: VisualizerSection, stop: Event, on_address: Callable[[str], None], unwatched_s: float = inf
) -> None:
    """Serves it until `stop`, or until nobody has had a page open for so long. Raises StartError.

    Calls `on_address` as soon as it can be opened.
    """
    server = PageServer(site, page.host, page.port, page.names)
    server.start()
    watched_s = time.monotonic()
    try:
        on_address(server.address)
        while server.running and time.monotonic() - watched_s < unwatched_s and not stop.wait(_POLL_S):
            watched_s = time.monotonic() if server.pages else watched_s
    finally:
        server.close()


class _RunClock:
    """Stands at the run's end: nothing grows older there."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def _when(run: RunLine) -> str:
    parts = [f"{run.date:%Y-%m-%d %H:%M}", run.floor]
    return ", ".join(filter(None, parts))


def _take_last_messages(feed: Feed, clock: _RunClock, run_dir: Path) -> None:
    """Each at the time at which it arrived. A database that cannot be read takes nothing from map and path."""
    try:
        with RunReader(run_dir) as run:
            newest = [message for topic in _LAST if (message := run.latest(topic)) is not None]
    except (StartError, OSError) as error:
        _log.warning("the last reports of the run cannot be read: %s", sentence(error))
        return
    for message in sorted(newest, key=lambda message: message.arrived_s):
        clock.now_s = message.arrived_s
        feed.take(message.topic, message.payload)


def _take_files(feed: Feed, run_dir: Path) -> None:
    data = read_map(run_dir)
    feed.take(MAP, MapUpdate(0.0, 1, 0, data.points_m.astype(np.float32), data.inferred))
    times_s, poses = read_path(run_dir)
    if len(times_s):
        x_m, y_m, heading_rad = poses[-1].tolist()
        pose = PoseEstimate(float(times_s[-1]), x_m, y_m, heading_rad, 0.0, 0.0, 0.0, 1)
        feed.take(POSE, pose)
        feed.take(TRAJECTORY, Trajectory(float(times_s[-1]), times_s, poses))
    feed.take(ZONES, message_of(0.0, data.zones))
    grid = _grid(run_dir)
    if grid is not None:
        feed.take(GRID, grid)
    feed.refresh_pois()


def _grid(run_dir: Path) -> GridUpdate | None:
    """The floor that was seen or driven over: the robot's own grid is not recorded."""
    try:
        image = occupancy_image.image_of_run(run_dir)
    except StartError as error:
        _log.warning("the floor of the run cannot be drawn: %s", sentence(error))
        return None
    if image.cells.size > GRID_CELLS_MAX:
        return None
    rows, columns = image.cells.shape
    origin = image.origin_x_m, image.origin_y_m
    return GridUpdate(
        0.0, 1, *origin, occupancy_image.CELL_M, rows, columns, zlib.compress(image.grid_cells().tobytes())
    )
