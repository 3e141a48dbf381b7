"""What counts as a number plate, by its lines, and what rapidocr makes of rendered ones."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from common.config import PoiSection
from common.geometry import Pose2
from offboard.simulator.building.floor import Plate
from offboard.simulator.camera.sign_textures import draw_plate
from onboard.poi.camera.camera_model import CameraModel
from onboard.poi.camera.frame import Frame
from onboard.poi.placement.wall_line import WallLine
from onboard.poi.signs.grouping import rows_of, signs
from onboard.poi.signs.ocr_engine import SignReader
from onboard.poi.signs.reading_job import Job, read
from onboard.poi.signs.sign_detection import Box
from onboard.poi.signs.sign_reading import SignReading, Verdict, sign_rules
from onboard.poi.signs.text_line import TextLine
from tests.unit.poi_scenes import SIDES, floor_with_door, full_frame

RULES = sign_rules(PoiSection())
M_PER_PX = 1 / 840


def lines(*texts: str, confidence: float = 0.99, height_px: float = 40.0) -> list[TextLine]:
    """Lines of one height, one below the other, in the middle of a picture 600 pixels high."""
    return [
        TextLine(text, confidence, 100.0, 200.0 + 1.8 * i * height_px, 0.625 * height_px * len(text), height_px)
        for i, text in enumerate(texts)
    ]


def verdict(*texts: str, **kwargs: float) -> Verdict:
    return RULES.judge(lines(*texts, **kwargs), M_PER_PX, 600.0).verdict


def shown(reading: SignReading) -> str:
    return reading.number.shown if reading.number is not None else ""


@pytest.fixture(scope="module")
def reader() -> SignReader:
    pytest.importorskip("rapidocr")
    return SignReader()


@pytest.mark.requirement("POI_MR_02")
@pytest.mark.parametrize(
    "poster",
    [
        ("Open day", "2019"),
        ("Offices", "253-260"),
        ("Rooms", "101-140", "upstairs"),
        ("Call 905 525", "9140"),
        ("Lost keys:", "call 5500"),
        ("Concert", "hall, doors", "20:15"),
        ("Career fair", "1500 jobs"),
        ("Exam week", "12-16 May", "2026"),
        ("Course 4711", "begins 3 May"),
        ("No smoking",),
        ("FIRE EXIT",),
        ("101", "102", "103"),
    ],
)
def test_posters_directions_and_lists_are_no_plates(poster: tuple[str, ...]) -> None:
    assert verdict(*poster) is Verdict.OTHER


def test_plate_holds_its_number_and_its_room_type() -> None:
    reading = RULES.judge(lines("215B", "Meeting Room"), M_PER_PX, 600.0)
    assert (reading.verdict, shown(reading), reading.room_type) == (Verdict.PLATE, "215B", "Meeting Room")


@pytest.mark.parametrize(
    ("pieces", "kind"), [(("Lab", "atory"), "Laboratory"), (("Off", "ice"), "Office"), (("Lab", "J. Park"), "Lab")]
)
def test_room_type_that_was_read_in_pieces_is_one(pieces: tuple[str, str], kind: str) -> None:
    (number,) = lines("118")
    left, right = (replace(lines(piece, height_px=24.0)[0], y_px=260.0) for piece in pieces)
    right = replace(right, x_px=left.right_px + 12.0, y_px=253.0)  # slanted: read before the left piece
    assert RULES.judge([number, right, left]).room_type == kind


@pytest.mark.parametrize(
    ("text", "kind"), [("Labratory", "Laboratory"), ("MEETING ROOM", "Meeting Room"), ("Open", "")]
)
def test_room_type_is_the_nearest_known_one(text: str, kind: str) -> None:
    assert RULES.room_type(text) == kind


def test_doubtful_reading_wants_another_photo() -> None:
    assert verdict("304", confidence=0.7) is Verdict.UNCLEAR


def test_number_at_the_border_may_be_the_rest_of_a_poster() -> None:
    at_the_top = [TextLine("2119", 0.99, 100.0, 10.0, 100.0, 40.0)]
    assert RULES.judge(at_the_top, M_PER_PX, 600.0).verdict is Verdict.UNCLEAR
    assert RULES.judge(at_the_top).verdict is Verdict.PLATE


def test_number_of_impossible_size_is_none() -> None:
    assert verdict("304", height_px=150.0) is Verdict.OTHER


def test_boxes_on_one_row_belong_together_and_signs_are_parted() -> None:
    boxes = [
        TextLine("905", 0.9, 160.0, 102.0, 50.0, 30.0),
        TextLine("Call", 0.99, 100.0, 100.0, 50.0, 30.0),
        TextLine("304", 0.95, 600.0, 100.0, 60.0, 30.0),
    ]
    texts = [[[line.text for line in row] for row in rows_of(sign)] for sign in signs(boxes)]
    assert sorted(texts) == [[["304"]], [["Call", "905"]]]


@pytest.mark.parametrize("style", ["dark on light", "light on dark", "dark on metal"])
def test_plates_of_every_style_are_read(reader: SignReader, style: str) -> None:
    plate = Plate(0.0, 0.0, False, 1.5, 0.2, 0.15, 0.04, style)
    for number, room_type in (("304", "Storage"), ("112B", ""), ("281A", "Meeting Room")):
        drawn = cv2.resize(on_wall(plate, number, room_type), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        readings = [RULES.judge(group) for group in signs(reader.lines(drawn))]
        assert [(r.verdict, shown(r), r.room_type) for r in readings] == [(Verdict.PLATE, number, room_type)]


def test_reading_repeats_to_the_bit(reader: SignReader) -> None:
    picture = on_wall(Plate(0.0, 0.0, False, 1.5, 0.2, 0.15, 0.04, "dark on light"), "304", "Office")
    assert reader.lines(picture) == reader.lines(picture)


def test_blurred_plate_is_not_accepted(reader: SignReader) -> None:
    picture = on_wall(Plate(0.0, 0.0, False, 1.5, 0.2, 0.15, 0.04, "dark on light"), "304", "")
    blurred = cv2.GaussianBlur(picture, (0, 0), 28.0)
    assert all(RULES.judge(group).verdict is not Verdict.PLATE for group in signs(reader.lines(blurred)))


@pytest.mark.parametrize("side", SIDES)
def test_plate_reads_correctly_on_walls_of_all_four_directions(reader: SignReader, side: str) -> None:
    frame = full_frame(floor_with_door(side, number="417", room_type="Storage"))
    assert [line.text for line in reader.lines(frame)] == ["417", "Storage"]


def on_wall(plate: Plate, number: str, room_type: str) -> Any:
    """The plate's picture with some wall around it, in the order of colours that OpenCV takes."""
    image = np.asarray(draw_plate(plate, number, room_type))[..., ::-1]
    return cv2.copyMakeBorder(image, 80, 80, 80, 80, cv2.BORDER_CONSTANT, value=(220, 226, 230))


@pytest.mark.parametrize("distance_m", [0.7, 1.0, 1.3])
def test_large_number_alone_on_its_plate_is_read_from_near_and_far(reader: SignReader, distance_m: float) -> None:
    floor = floor_with_door("south", number="217", room_type="")
    floor["doors"][0]["plate"]["number_height_m"] = 0.05
    floor["starts"][0]["y_m"] = distance_m
    camera, frame = CameraModel(1280, 960), Frame(0.0, full_frame(floor))
    candidate = Box(600.0, 400.0, 80.0, 40.0)
    job = Job(frame, Pose2(0.0, 0.0, 0.0), WallLine(distance_m, 0.0), candidate)
    assert [shown(f.reading) for f in read(job, reader, RULES, camera).findings] == ["217"]


@pytest.mark.parametrize("text", ["Open day 2019", "Call 905 525 9140", "Rooms 101-140 upstairs"])
@pytest.mark.parametrize("distance_m", [0.7, 1.0, 1.4])
def test_drawn_poster_is_never_taken(reader: SignReader, text: str, distance_m: float) -> None:
    floor = floor_with_door("south", poster=text)
    floor["starts"][0]["y_m"] = distance_m
    camera, frame = CameraModel(1280, 960), Frame(0.0, full_frame(floor))
    job = Job(frame, Pose2(0.0, 0.0, 0.0), WallLine(distance_m, 0.0), Box(600.0, 400.0, 80.0, 40.0))
    readings = [f.reading for f in read(job, reader, RULES, camera).findings]
    assert all(reading.verdict is not Verdict.PLATE for reading in readings)
