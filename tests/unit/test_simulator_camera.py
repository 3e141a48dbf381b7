"""The simulated camera: signs read correctly on every wall, and frames fail as real ones do."""

from __future__ import annotations

from collections.abc import Iterator
from math import pi

import cv2
import mujoco
import numpy as np
import pytest

from offboard.simulator.building.events import Events, OpenedDoor
from offboard.simulator.building.floor import Floor, parse_floor, wall_segments
from offboard.simulator.camera import camera as camera_module
from offboard.simulator.camera.camera import Camera, CameraUnavailable, open_gl_context
from offboard.simulator.camera.scenery import build_scenery
from offboard.simulator.camera.sign_textures import PLATE_PX_PER_M, draw_plate
from offboard.simulator.error_profiles import PROFILES
from offboard.simulator.physics.world import World
from onboard.poi.camera.frame import FULL_SIZE_PX, Image
from tests.unit.test_simulator_world import RecordingBoard

SIDES = {"east": (5.0, 2.5, 180.0), "north": (2.5, 5.0, -90.0), "west": (0.0, 2.5, 0.0), "south": (2.5, 0.0, 90.0)}


def square_floor() -> Floor:
    """A room of 5 m with a door and a plate on the middle of each wall."""
    doors = []
    for i, (x_m, y_m, normal_deg) in enumerate(SIDES.values()):
        plate = {"x_m": x_m, "y_m": y_m, "on_door": True, "centre_height_m": 1.45, "width_m": 0.25, "height_m": 0.18}
        plate |= {"number_height_m": 0.05, "style": ["dark on light", "light on dark"][i % 2]}
        door = {"x_m": x_m, "y_m": y_m, "normal_deg": normal_deg, "width_m": 0.9, "height_m": 2.05}
        doors.append(door | {"colour_rgb": [150, 100, 60], "number": f"{i + 2}47R", "room_type": "Lab", "plate": plate})
    content = {
        "name": "square",
        "units": "m",
        "wall_colour_rgb": [230, 230, 225],
        "corridor": {"exterior": [[0, 0], [5, 0], [5, 5], [0, 5]], "holes": []},
        "doors": doors,
        "posters": [],
        "starts": [{"x_m": 2.5, "y_m": 2.5, "heading_deg": 0.0}],
    }
    return parse_floor(content, "floor file square")


@pytest.fixture(scope="module")
def gl_available() -> None:
    try:
        open_gl_context(64, 64).free()
    except CameraUnavailable as error:
        pytest.skip(str(error))


@pytest.fixture
def square(gl_available: None) -> Iterator[tuple[World, Camera]]:
    floor = square_floor()
    world = World(floor, 0, 1, PROFILES["none"], RecordingBoard(), scenery=build_scenery(floor, "clean", 1))
    camera = Camera(world, "clean")
    yield world, camera
    camera.close()


def put(world: World, x_m: float, y_m: float, heading_rad: float) -> None:
    world.data.qpos[:] = (x_m, y_m, heading_rad)
    mujoco.mj_forward(world.model, world.data)
    world.step()


def similarity(frame: Image, expected: Image) -> float:
    """Correlation of a picture with the best place in a frame."""
    grey = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in (frame, expected)]
    return float(cv2.matchTemplate(grey[0], grey[1], cv2.TM_CCOEFF_NORMED).max())


@pytest.mark.parametrize("side", range(4), ids=list(SIDES))
def test_a_plate_reads_correctly_on_walls_of_all_four_directions(square: tuple[World, Camera], side: int) -> None:
    world, camera = square
    door = world.floor.doors[side]
    distance_m = 1.2
    # The camera looks to the right, so the robot drives with the wall on its right
    x_m = door.x_m + distance_m * np.cos(door.normal_rad)
    y_m = door.y_m + distance_m * np.sin(door.normal_rad)
    put(world, x_m, y_m, door.normal_rad - pi / 2)
    frame = camera.full()
    assert frame is not None
    assert frame.shape == (FULL_SIZE_PX[1], FULL_SIZE_PX[0], 3)
    texture = np.asarray(draw_plate(door.plate, door.number, door.room_type))[:, :, ::-1]
    focal_px = FULL_SIZE_PX[0] / 2 / np.tan(0.47)
    scale = focal_px / (distance_m - 0.025) / PLATE_PX_PER_M
    expected = cv2.resize(texture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    assert similarity(frame, expected) > 0.9
    assert similarity(frame, expected[:, ::-1]) < 0.75
    assert similarity(frame, expected[::-1]) < 0.75


def test_the_preview_shows_what_the_full_frame_shows(square: tuple[World, Camera]) -> None:
    world, camera = square
    put(world, 1.5, 2.5, pi / 2)
    full, preview = camera.full(), camera.preview()
    assert full is not None
    assert preview is not None
    assert preview.shape == (480, 640, 3)
    small = cv2.resize(full, (640, 480), interpolation=cv2.INTER_AREA)
    assert np.abs(small.astype(int) - preview.astype(int)).mean() < 3.0


def test_a_moving_robot_takes_blurred_pictures(gl_available: None) -> None:
    floor = square_floor()
    board = RecordingBoard()
    world = World(floor, 0, 1, PROFILES["none"], board, scenery=build_scenery(floor, "realistic", 1))
    camera = Camera(world, "realistic")
    sharpness = []
    for pwm in (0, 200):
        put(world, 2.5, 1.2, 0.0)
        board.drive = (pwm, pwm, True)
        while pwm and world.true_motion[0] < 0.25:
            world.step()
        frame = camera.full()
        assert frame is not None
        grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        sharpness.append(float(np.percentile(np.abs(cv2.Sobel(grey, cv2.CV_32F, 1, 0)), 99.7)))
    camera.close()
    assert sharpness[1] < 0.7 * sharpness[0]


def test_hard_frames_are_lost_noisy_and_change_in_brightness(gl_available: None) -> None:
    floor = square_floor()
    world = World(floor, 0, 2, PROFILES["none"], RecordingBoard(), scenery=build_scenery(floor, "hard", 2))
    camera = Camera(world, "hard")
    means, lost = [], 0
    for _ in range(60):
        frame = camera.preview()
        if frame is None:
            lost += 1
        else:
            means.append(frame.mean())
        for _ in range(100):
            world.step()
    camera.close()
    assert 0 < lost < 12
    assert max(means) > 1.5 * min(means)


def test_without_an_opengl_library_one_sentence_names_the_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera_module, "_LIBRARIES", ())
    with pytest.raises(CameraUnavailable, match="libegl1 libopengl0 libgl1-mesa-dri") as caught:
        open_gl_context(64, 64)
    assert "\n" not in str(caught.value)


def test_leaf_of_an_opened_door_is_no_longer_drawn_and_its_frame_stays() -> None:
    floor = square_floor()
    events = Events(opened=(OpenedDoor(0.1, floor.doors[0], wall_segments(floor)[:0]),))
    world = World(
        floor, 0, 1, PROFILES["none"], RecordingBoard(), events=events, scenery=build_scenery(floor, "clean", 1)
    )
    before = world.model.ngeom
    for _ in range(30):
        world.step()
    leaf_handle_plate = 3
    wall_in_two = 1
    assert world.model.ngeom == before - leaf_handle_plate + wall_in_two
