"""A whole simulated robot below the bridge: world, board, serial line and camera in one object with one clock.

`simulate` advances it in lockstep with the nodes and takes `port`; the process "simulator" advances it as master of the
shared clock and gives its serial line away as a device (`pty_link`).
"""

from __future__ import annotations

import logging
from pathlib import Path
from types import TracebackType

import numpy as np

from offboard.runs.run_folder import TRUTH_NAME, write_tum
from offboard.simulator.building.events import Events
from offboard.simulator.building.floor import Floor
from offboard.simulator.camera.camera import Camera, CameraUnavailable
from offboard.simulator.camera.scenery import build_scenery
from offboard.simulator.electronics.board import Board
from offboard.simulator.electronics.pty_port import PtyPort
from offboard.simulator.electronics.serial_line import HostPort, SerialLine
from offboard.simulator.error_profiles import PROFILES, random_stream
from offboard.simulator.physics.world import STEP_S, World
from offboard.simulator.run.options import CAMERAS
from offboard.simulator.stopwatch import REST, Stopwatch

_ROUNDING_S = 1e-9

_log = logging.getLogger("simulator")


class Simulation:
    """Owns the world of one run; a context manager, since a device and a renderer may have to be given back."""

    def __init__(
        self,
        floor: Floor,
        board: Board,
        *,
        start_index: int = 0,
        seed: int = 0,
        errors: str = "realistic",
        camera: str = "off",
        events: Events | None = None,
        pty_link: Path | None = None,
        stopwatch: Stopwatch | None = None,
    ) -> None:
        """`errors`: a name in errors.PROFILES; `camera`: one of options.CAMERAS. `pty_link` puts the serial
        line behind a pseudo-terminal of that name; else `port` is its host end. `camera` stays None where no OpenGL
        library is to be had. Raises FloorError.
        """
        if camera not in CAMERAS:
            raise ValueError(f"there is no camera {camera!r}, choose one of {', '.join(CAMERAS)}")
        profile = PROFILES[errors]
        line = SerialLine(profile, random_stream(seed, "serial"), STEP_S)
        self._pty = PtyPort(line, pty_link) if pty_link is not None else None
        self.port = HostPort(line)
        scenery = None if camera == "off" else build_scenery(floor, camera, seed)
        self.camera: Camera | None = None
        self.stopwatch = stopwatch or Stopwatch()
        self.world = World(floor, start_index, seed, profile, board, self._pty or line, events, scenery, self.stopwatch)
        if camera != "off":
            self._open_camera(camera)

    def _open_camera(self, mode: str) -> None:
        try:
            self.camera = Camera(self.world, mode)
        except CameraUnavailable as error:
            _log.warning("camera=unavailable reason=%r", str(error))

    def advance(self, until_s: float) -> None:
        """Steps the world until its time has reached `until_s`."""
        steps = int((until_s - self.world.time_s + _ROUNDING_S) / STEP_S)
        while steps > 0:
            steps -= self.world.run(steps)
        self.stopwatch.enter(REST)

    def run(self, count: int) -> int:
        """Up to `count` steps of the world, fewer where the host has something to read; returns how many."""
        done = self.world.run(count)
        while done < count and not self.port.readable:
            done += self.world.run(count - done)
        self.stopwatch.enter(REST)
        return done

    def write_truth(self, run_dir: Path) -> None:
        """`truth.tum`: the true poses at 10 Hz in the floor's frame, on the clock of the world."""
        log = np.array(self.world.truth_log)
        write_tum(run_dir / TRUTH_NAME, log[:, 0], log[:, 1:])

    def close(self) -> None:
        if self.camera is not None:
            self.camera.close()
        if self._pty is not None:
            self._pty.close()

    def __enter__(self) -> Simulation:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
