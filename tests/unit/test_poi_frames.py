"""Frame sources, the socket of the simulated camera, the reading workers, and photos from the command line."""

from __future__ import annotations

import json
import socket
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import pytest

from common.config import PoiSection
from common.config_file import load_config
from common.errors import StartError
from common.geometry import Pose2
from deploy.cli import main
from offboard.simulator.building.floor import Plate
from offboard.simulator.camera.camera import Camera
from offboard.simulator.camera.frame_server import FrameServer
from offboard.simulator.camera.sign_textures import draw_plate
from onboard.poi.camera.calibration import field_of_view_deg
from onboard.poi.camera.camera_model import CameraModel
from onboard.poi.camera.frame import Frame, Image
from onboard.poi.camera.frame_socket import SocketFrames
from onboard.poi.camera.frame_source import open_source
from onboard.poi.camera.sharpness import sharpness
from onboard.poi.placement.wall_line import WallLine
from onboard.poi.signs.reading_job import Job, read
from onboard.poi.signs.sign_detection import Box, sign_candidates
from onboard.poi.signs.sign_reading import Verdict, sign_rules
from onboard.poi.signs.site_numbers import PLATES_MIN
from onboard.poi.signs.text_line import TextLine


class DrawnCamera:
    """Stands in for the camera of a simulation."""

    def preview(self) -> Image:
        return np.full((480, 640, 3), 7, np.uint8)

    def full(self) -> Image:
        return np.full((960, 1280, 3), 9, np.uint8)


def until(condition: Callable[[], Any], within_s: float = 10.0) -> Any:
    deadline_s = time.monotonic() + within_s
    while not (value := condition()):
        assert time.monotonic() < deadline_s, "waited too long"
        time.sleep(0.005)
    return value


@pytest.fixture
def socket_path() -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as folder:  # short: a socket's path may have 107 characters
        yield Path(folder) / "frames"


def test_previews_come_by_themselves_and_full_frames_on_request(socket_path: Path) -> None:
    server = FrameServer(cast(Camera, DrawnCamera()), socket_path)
    source = SocketFrames(socket_path)
    clock = iter(np.arange(0.0, 1e4, 0.05))

    def preview() -> Frame | None:
        server.step(float(next(clock)))
        return source.preview(0.0)

    def full() -> Frame | None:
        source.request_full()
        server.step(float(next(clock)))
        return source.full(0.0)

    assert until(preview).image.shape == (480, 640, 3)
    frame = until(full)
    assert frame.image.shape == (960, 1280, 3)
    assert frame.t_s > 0.0
    source.close()
    server.close()


def test_server_that_comes_later_and_again_is_found(socket_path: Path) -> None:
    source = SocketFrames(socket_path)
    source.request_full()
    for start_s in (0.0, 100.0):
        server = FrameServer(cast(Camera, DrawnCamera()), socket_path)
        clock = iter(np.arange(start_s, start_s + 1e4, 0.05))

        def looks(server: FrameServer = server, clock: Iterator[float] = clock) -> Frame | None:
            server.step(float(next(clock)))
            return source.preview(0.0)

        assert until(looks).t_s >= start_s
        server.close()
        until(lambda: source._socket is None)
        source.preview(0.0)
    source.close()


def test_receiver_that_takes_nothing_does_not_hold_the_simulator(socket_path: Path) -> None:
    server = FrameServer(cast(Camera, DrawnCamera()), socket_path)
    with socket.socket(socket.AF_UNIX) as idle:
        idle.connect(str(socket_path))
        until(lambda: server._link is not None)
        began_s = time.monotonic()
        for i in range(100):
            server.step(0.4 * i)
        assert time.monotonic() - began_s < 2.0
    server.close()


def test_folder_of_photos_is_a_camera(tmp_path: Path) -> None:
    for name in ("b.png", "a.png"):
        cv2.imwrite(str(tmp_path / name), np.full((960, 1280, 3), ord(name[0]), np.uint8))
    source = open_source(str(tmp_path))
    preview = source.preview(0.0)
    assert preview is not None
    assert preview.image[0, 0, 0] == ord("a")
    assert source.preview(0.1) is None
    assert source.full(0.1) is None
    source.request_full()
    full = source.full(0.1)
    assert full is not None
    assert full.image.shape == (960, 1280, 3)


@pytest.mark.parametrize("uri", ["/dev/video97", "no/such/folder", "picamera"])
def test_camera_that_is_not_there_is_reported_in_a_sentence(uri: str) -> None:
    with pytest.raises(StartError, match=r"[Cc]amera|photo"):
        open_source(uri)


# Reading


class Letters:
    """A reader that sees the same lines on every picture."""

    def __init__(self, *lines: TextLine) -> None:
        self._lines = list(lines)

    def lines(self, image: Image) -> list[TextLine]:
        return self._lines


RULES = sign_rules(PoiSection(number_pattern="[0-9]{3}[A-Z]?", room_types=("Office",)))
CAMERA = CameraModel(1280, 960)


def job() -> Job:
    image = np.full((960, 1280, 3), 200, np.uint8)
    return Job(Frame(1.0, image), Pose2(0.0, 0.0, 0.0), WallLine(1.0, 0.0), Box(600.0, 400.0, 80.0, 60.0))


def test_sign_that_the_part_cuts_off_is_left_out() -> None:
    cut = TextLine("215", 0.99, 2.0, 200.0, 90.0, 40.0)
    whole = TextLine("215B", 0.99, 300.0, 200.0, 120.0, 40.0)
    assert read(job(), Letters(cut), RULES, CAMERA).findings == ()
    (finding,) = read(job(), Letters(whole), RULES, CAMERA).findings
    assert finding.reading.verdict is Verdict.PLATE
    assert finding.reading.number is not None
    assert finding.reading.number.shown == "215B"


# Candidates and sharpness


def plate_picture(blur_px: float = 0.0) -> Image:
    """What a preview shows of a plate in the middle of a wall 1.0 m away."""
    plate = np.asarray(draw_plate(Plate(0, 0, False, 1.5, 0.2, 0.15, 0.04, "dark on light"), "304", "Office"))[
        ..., ::-1
    ]
    small = cv2.resize(plate, (126, 94), interpolation=cv2.INTER_AREA)
    image = np.full((480, 640, 3), (222, 230, 232), np.uint8)
    image[160 : 160 + 94, 260 : 260 + 126] = small
    return np.asarray(cv2.GaussianBlur(image, (0, 0), blur_px), np.uint8) if blur_px else image


def test_plate_is_a_candidate_and_a_bare_wall_is_none() -> None:
    camera = CameraModel(640, 480)
    (box,) = sign_candidates(cv2.cvtColor(plate_picture(), cv2.COLOR_BGR2GRAY), camera, 1.0)
    assert box.centre_px == pytest.approx((323, 207), abs=25)
    assert sign_candidates(np.full((480, 640), 230, np.uint8), camera, 1.0) == []


@pytest.mark.parametrize("light", [0.2, 0.5, 1.0])
def test_plate_in_a_noisy_picture_is_a_candidate_and_the_noise_is_none(light: float) -> None:
    camera, noise = CameraModel(640, 480), np.random.default_rng(1).normal(0.0, 8.0, (480, 640))
    gray, bare = (np.clip(light * g + noise, 0, 255).astype(np.uint8) for g in (
        cv2.cvtColor(plate_picture(), cv2.COLOR_BGR2GRAY), np.full((480, 640), 230)))  # fmt: skip
    boxes = sign_candidates(gray, camera, 1.0)
    assert any(box.centre_px == pytest.approx((323, 207), abs=40) for box in boxes)
    assert sign_candidates(bare, camera, 1.0) == []


def test_sharper_photo_ranks_higher_by_every_measure() -> None:
    sharp, blurred = (sharpness(cv2.cvtColor(plate_picture(b), cv2.COLOR_BGR2GRAY)[150:270, 250:400]) for b in (0, 3))
    assert sharp.gradient > blurred.gradient
    assert sharp.laplacian_variance > blurred.laplacian_variance
    assert sharp.high_frequency_share > blurred.high_frequency_share


# Verbs


def test_read_signs_prints_a_json_line_for_every_plate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rapidocr")
    photo = cv2.resize(plate_picture(), None, fx=2, fy=2)
    cv2.imwrite(str(tmp_path / "plate.png"), photo)
    sidecar = {"x_m": 2.0, "y_m": 1.0, "heading_rad": 0.0, "wall_m": 1.0}
    (tmp_path / "plate.json").write_text(json.dumps(sidecar), encoding="utf-8")
    cv2.imwrite(str(tmp_path / "wall.png"), np.full((960, 1280, 3), 200, np.uint8))
    assert main(["read-signs", str(tmp_path)]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    finding = json.loads(line)
    assert (finding["number"], finding["room_type"]) == ("304", "Office")
    assert (finding["x_m"], finding["y_m"]) == pytest.approx((2.0, 0.0), abs=0.05)


FIELDS = ["image", "kind", "text", "number", "key", "room_type", "confidence", "state", "box", "reason"]


def plate_photo(number: str, room_type: str = "") -> Image:
    plate = np.asarray(draw_plate(Plate(0, 0, False, 1.5, 0.2, 0.15, 0.035, "dark on light"), number, room_type))
    return cv2.copyMakeBorder(
        np.ascontiguousarray(plate[..., ::-1]), 240, 240, 240, 240, cv2.BORDER_CONSTANT, value=(222, 230, 232)
    )


@pytest.fixture
def read_signs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[dict[str, dict[str, Any]], str]]:
    """`read_signs(number=photo, ..., toml="")` -> what was printed by the photo's name, and what went to stderr."""
    pytest.importorskip("rapidocr")

    def run(*arguments: str, toml: str = "", **photos: Image) -> tuple[dict[str, dict[str, Any]], str]:
        (tmp_path / "photos").mkdir()
        (tmp_path / "robot.toml").write_text(toml, encoding="utf-8")
        for name, photo in photos.items():
            cv2.imwrite(str(tmp_path / "photos" / f"{name}.png"), photo)
        config = ["--config", str(tmp_path / "robot.toml")]
        assert main(["read-signs", str(tmp_path / "photos"), *config, *arguments]) == 0
        out, err = capsys.readouterr()
        return {Path(f["image"]).stem: f for f in map(json.loads, out.splitlines())}, err

    return run


def test_read_signs_prints_what_a_sign_is_and_why(read_signs: Callable[..., Any], tmp_path: Path) -> None:
    toml = '[poi]\nnumber_presets = ["building-room"]'
    folder = tmp_path / "explained"
    photos = {
        "plate": plate_photo("16-101", "Office"),
        "foreign": plate_photo("2.01"),
        "sign": plate_photo("FIRE EXIT"),
    }
    found, _ = read_signs("--explain", str(folder), toml=toml, **photos)
    assert [list(finding) for finding in found.values()] == [FIELDS] * 3
    shown = {name: [finding[f] for f in ("kind", "number", "key", "state")] for name, finding in found.items()}
    assert shown == {
        "plate": ["plate", "16-101", "16-101", "read"],
        "foreign": ["plate", "", "", "unread"],
        "sign": ["other", "", "", "unread"],
    }
    assert (found["plate"]["text"], found["plate"]["room_type"], found["plate"]["reason"]) == (
        "16-101\nOffice",
        "Office",
        "",
    )
    assert found["foreign"]["reason"] == "the site's numbers are not floor.room"
    assert found["sign"]["reason"]
    pictures = sorted(folder.iterdir())
    assert [cv2.imread(str(picture)).shape for picture in pictures] == [photos[name].shape for name in sorted(photos)]


def test_read_signs_learns_the_form_that_most_plates_share(read_signs: Callable[..., Any]) -> None:
    photos = {f"photo{n}": plate_photo(f"16-{n}") for n in range(101, 101 + PLATES_MIN)}
    found, complaint = read_signs(**photos)
    assert {finding["number"]: finding["state"] for finding in found.values()} == {
        f"16-{n}": "read" for n in range(101, 101 + PLATES_MIN)
    }
    assert 'number_presets = ["building-room"]' in complaint


def test_read_signs_goes_on_after_a_photo_that_it_cannot_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rapidocr")
    (tmp_path / "a damaged.jpg").write_bytes(b"no picture")
    cv2.imwrite(str(tmp_path / "b plate.png"), cv2.resize(plate_picture(), None, fx=2, fy=2))
    (tmp_path / "c empty.png").write_bytes(b"")
    assert main(["read-signs", str(tmp_path)]) == 2
    out, err = capsys.readouterr()
    assert [json.loads(line)["number"] for line in out.splitlines()] == ["304"]
    complaints = err.splitlines()
    assert len(complaints) == 2
    assert "a damaged.jpg is no picture" in complaints[0]
    assert "c empty.png is no picture" in complaints[1]


def test_read_signs_without_a_photo_reports_what_it_needs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["read-signs", str(tmp_path / "none.jpg")]) == 2
    assert "There is no photo" in capsys.readouterr().err


def door_photo(file: Path, wall: tuple[int, int, int]) -> Path:
    """A brown door in the middle, wall left and right of it."""
    photo = np.full((480, 640, 3), wall, np.uint8)
    photo[:, 100:540] = (62, 104, 150)
    cv2.imwrite(str(file), photo)
    return file


def test_calibrate_doors_writes_their_colours_and_shows_what_counts_as_door(tmp_path: Path) -> None:
    photo, config = door_photo(tmp_path / "door.png", (222, 230, 232)), tmp_path / "robot.toml"
    for _ in range(2):
        assert main(["calibrate", "doors", str(photo), "--config", str(config)]) == 0
    (colour,) = load_config(config).poi.door_colours
    assert colour.startswith("H8-20 ")
    mask = cv2.imread(str(tmp_path / "door-door.png"))
    assert mask[240, 320].tolist() == [62, 104, 150]
    assert mask[240, 10].max() < 60


def test_calibrate_doors_refuses_what_does_not_tell_door_from_wall(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photo, config = door_photo(tmp_path / "door.png", (64, 106, 152)), tmp_path / "robot.toml"
    assert main(["calibrate", "doors", str(photo), "--config", str(config)]) == 2
    assert "The wall has the colour of the door" in capsys.readouterr().err
    assert not config.exists()
    assert (tmp_path / "door-door.png").exists()
    wall = tmp_path / "wall.png"
    cv2.imwrite(str(wall), np.full((480, 640, 3), (222, 230, 232), np.uint8))
    assert main(["calibrate", "doors", str(photo), "--wall", str(wall), "--config", str(config)]) == 0


def test_calibrate_camera_measures_the_field_of_view(tmp_path: Path) -> None:
    photo, config = tmp_path / "board.png", tmp_path / "robot.toml"
    cv2.imwrite(str(photo), chessboard_view(focal_px=900.0))
    assert main(["calibrate", "camera", str(photo), "--config", str(config)]) == 0
    true_deg = np.degrees(2 * np.arctan(640 / 900.0))
    assert load_config(config).poi.field_of_view_deg == pytest.approx(true_deg, abs=1.0)


def test_half_a_jpeg_is_no_photo(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    photo, config = tmp_path / "door.jpg", tmp_path / "robot.toml"
    photo.write_bytes(cv2.imencode(".jpg", chessboard_view(focal_px=900.0))[1].tobytes()[:-5000])
    assert main(["calibrate", "doors", str(photo), "--config", str(config)]) == 2
    assert "door.jpg is only a part of a picture" in capsys.readouterr().err
    assert not config.exists()


def test_calibrating_without_a_board_reports_what_to_do() -> None:
    with pytest.raises(StartError, match="No photo shows a chessboard"):
        field_of_view_deg([np.full((480, 640, 3), 200, np.uint8)], 9, 6)


def chessboard_view(focal_px: float) -> Image:
    """A board of 10 x 7 squares, tilted, as a camera without distortion sees it."""
    board = np.full((9 * 60, 12 * 60, 3), 255, np.uint8)
    for row in range(7):
        for column in range(10):
            if (row + column) % 2 == 0:
                board[(row + 1) * 60 : (row + 2) * 60, (column + 1) * 60 : (column + 2) * 60] = 0
    rotation, _ = cv2.Rodrigues(np.array([0.5, -0.45, 0.1]))
    intrinsics = np.array([[focal_px, 0, 640], [0, focal_px, 480], [0, 0, 1]])
    from_pixels = np.array([[1 / 60, 0, -6], [0, 1 / 60, -4.5], [0, 0, 1]])
    homography = intrinsics @ np.column_stack([rotation[:, 0], rotation[:, 1], [0, 0, 13.0]]) @ from_pixels
    return np.asarray(cv2.warpPerspective(board, homography, (1280, 960), borderValue=(180, 180, 180)), np.uint8)
