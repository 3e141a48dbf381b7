"""The robot's camera in the simulated building: full frames, and the small preview that Picamera2 gives beside them.

MuJoCo renders; this module adds the faults of a real camera: motion blur from exposure and true motion, noise, gradual
changes of brightness, lost frames. Without an OpenGL library everything else runs without frames.
"""

from __future__ import annotations

import ctypes.util
import importlib
import os
import warnings
from math import inf, pi, sin, tan
from typing import Any

import cv2
import mujoco
import numpy as np
import numpy.typing as npt

from common.constants import CAMERA_FIELD_OF_VIEW_RAD
from offboard.simulator.error_profiles import PROFILES, ErrorProfile, random_stream
from offboard.simulator.physics.mujoco_model import CAMERA_NAME
from offboard.simulator.physics.world import World
from offboard.simulator.stopwatch import CAMERA
from onboard.poi.camera.frame import FULL_SIZE_PX, PREVIEW_SIZE_PX, Image

_BRIGHTNESS_PERIOD_S = 47.0
_DARK_CELL_M, _DARK_SHARE, _DARKNESS = 8.0, 0.3, 0.35
_MAX_GEOMS = 4000
_LIBRARIES = (("egl", "EGL"), ("osmesa", "OSMesa"), ("glfw", "glfw"))
# What the backends raise without a display or with a half-installed library
_BACKEND_ERRORS = (
    ImportError,
    AttributeError,
    TypeError,
    RuntimeError,
    OSError,
    ctypes.ArgumentError,
    mujoco.FatalError,
)
_EMPTY_MODEL = mujoco.MjModel.from_xml_string("<mujoco/>")

_PROFILE_OF_MODE = {"clean": "none", "realistic": "realistic", "hard": "harsh"}


class CameraUnavailable(RuntimeError):
    """This machine has no OpenGL library that renders; the message names what to install."""


def open_gl_context(width_px: int, height_px: int) -> Any:
    """A current OpenGL context without a window: EGL, else OSMesa, else GLFW; raises CameraUnavailable."""
    for backend, library in _LIBRARIES:
        if backend != "glfw" and ctypes.util.find_library(library) is None:
            continue
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                context = importlib.import_module(f"mujoco.{backend}").GLContext(width_px, height_px)
                context.make_current()
            # GLFW without a display fails here and not before
            mujoco.MjrContext(_EMPTY_MODEL, mujoco.mjtFontScale.mjFONTSCALE_100).free()
            return context
        except _BACKEND_ERRORS:
            os.environ.pop("PYOPENGL_PLATFORM", None)
    raise CameraUnavailable(
        "No camera frames without an OpenGL library: run 'apt install libegl1 libopengl0 libgl1-mesa-dri', "
        "or use --camera off."
    )


class Camera:
    """Renders the view of the camera on a world's robot. The world must have been built with a scenery."""

    def __init__(self, world: World, mode: str) -> None:
        """`mode`: "clean", "realistic" or "hard". Raises CameraUnavailable."""
        cv2.setNumThreads(1)
        self._world, self._hard = world, mode == "hard"
        self._profile: ErrorProfile = PROFILES[_PROFILE_OF_MODE[mode]]
        self._rng = random_stream(world.seed, "camera")
        self._noise_rng = np.random.default_rng(self._rng.getrandbits(64))
        self._noise = self._noise_field()
        self._phase_rad = world.errors.brightness_phase_rad
        self._gl = open_gl_context(*FULL_SIZE_PX)
        self._model: Any = None
        self._renderer: Any = None

    def full(self) -> Image | None:
        """(960, 1280, 3) blue green red; None when the frame was lost."""
        return self._capture(*FULL_SIZE_PX)

    def preview(self) -> Image | None:
        """The same view, (480, 640, 3); None when the frame was lost."""
        return self._capture(*PREVIEW_SIZE_PX)

    def close(self) -> None:
        if self._model is not None:
            self._renderer.free()
            self._model = None
        self._gl.free()

    def _capture(self, width_px: int, height_px: int) -> Image | None:
        if self._rng.random() < self._profile.camera_loss:
            return None
        before = self._world.stopwatch.enter(CAMERA)
        image = self._blurred(self._draw(width_px, height_px), width_px)
        gain = self._brightness()
        if gain != 1.0:
            image = cv2.convertScaleAbs(image, alpha=gain)
        image = self._noisy(image)
        self._world.stopwatch.enter(before)
        return image

    def _draw(self, width_px: int, height_px: int) -> Image:
        self._gl.make_current()
        world = self._world
        if self._model is not world.model:
            self._load(world.model)
        mujoco.mj_camlight(world.model, world.data)
        mujoco.mjv_updateScene(
            world.model, world.data, self._option, None, self._view, mujoco.mjtCatBit.mjCAT_ALL.value, self._scene
        )
        rectangle = mujoco.MjrRect(0, 0, width_px, height_px)
        mujoco.mjr_render(rectangle, self._scene, self._renderer)
        image = np.empty((height_px, width_px, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(image, None, rectangle, self._renderer)
        # OpenGL's first row is the lowest one
        return np.asarray(cv2.flip(cv2.cvtColor(image, cv2.COLOR_RGB2BGR), 0), dtype=np.uint8)

    def _load(self, model: Any) -> None:
        """Textures and shapes of a (new) model into the OpenGL context."""
        if self._model is not None:
            self._renderer.free()
        self._model = model
        self._scene = mujoco.MjvScene(model, _MAX_GEOMS)
        self._option = mujoco.MjvOption()
        self._view = mujoco.MjvCamera()
        self._view.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._view.fixedcamid = model.camera(CAMERA_NAME).id
        self._renderer = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._renderer)

    def _blurred(self, image: Image, width_px: int) -> Image:
        """Blur along x, as long as the wall's motion through the image during the exposure."""
        speed_m_s, yaw_rate_rad_s = self._world.true_motion
        pose = self._world.truth
        wall_m = self._world.echo_model.wall_ahead_m(pose.x_m, pose.y_m, pose.heading_rad - pi / 2)
        focal_px = width_px / 2 / tan(CAMERA_FIELD_OF_VIEW_RAD / 2)
        rate_rad_s = yaw_rate_rad_s + (speed_m_s / wall_m if wall_m != inf else 0.0)
        length_px = abs(rate_rad_s) * self._profile.camera_exposure_s * focal_px
        if length_px < 0.2:
            return image
        half = int(length_px / 2 + 0.5)
        offsets = np.arange(-half, half + 1, dtype=np.float64)
        kernel = np.clip((length_px + 1.0) / 2 - np.abs(offsets), 0.0, 1.0)
        if half == 0:
            return image
        return np.asarray(cv2.filter2D(image, -1, (kernel / kernel.sum())[None, :]), dtype=np.uint8)

    def _brightness(self) -> float:
        change = self._profile.camera_brightness * sin(
            self._phase_rad + 2.0 * pi * self._world.time_s / _BRIGHTNESS_PERIOD_S
        )
        gain = 1.0 + change
        if self._hard and self._in_dark_hall():
            gain *= _DARKNESS
        return gain

    def _in_dark_hall(self) -> bool:
        """Some stretches of a "hard" floor have a broken lamp, always the same ones for a seed."""
        pose = self._world.truth
        cell = int(pose.x_m // _DARK_CELL_M), int(pose.y_m // _DARK_CELL_M)
        drawn = np.random.SeedSequence([self._world.seed, cell[0] & 0xFFFF, cell[1] & 0xFFFF]).generate_state(1)[0]
        return bool(drawn / 2.0**32 < _DARK_SHARE)

    def _noise_field(self) -> npt.NDArray[np.int16] | None:
        """Noise for a frame and a margin: a frame takes a random part of it, a tenth of the cost of drawing it anew."""
        if self._profile.camera_noise_sd == 0.0:
            return None
        shape = (FULL_SIZE_PX[1] + 64, FULL_SIZE_PX[0] + 64, 3)
        field = self._noise_rng.normal(0.0, self._profile.camera_noise_sd, shape)
        return np.asarray(np.round(field), dtype=np.int16)

    def _noisy(self, image: Image) -> Image:
        if self._noise is None:
            return image
        row, column = self._rng.randrange(64), self._rng.randrange(64)
        part = self._noise[row : row + image.shape[0], column : column + image.shape[1]]
        return np.asarray(cv2.add(image, part, dtype=cv2.CV_8U), dtype=np.uint8)
