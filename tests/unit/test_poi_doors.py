"""Edges of doors in a picture, their colours, and the records that merge observations."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from common.config import PoiSection
from onboard.poi.camera.camera_model import CameraModel
from onboard.poi.doors.door_association import State
from onboard.poi.doors.door_calibration import WALL_SHARE_MAX, calibrated_box, door_of, wall_of
from onboard.poi.doors.door_detection import ColourBox, DoorDetector, DoorEdge, Side, door_edges
from onboard.poi.doors.door_records import DoorRecords
from onboard.poi.doors.jamb_lines import Beside, JambView
from onboard.poi.doors.observations import Sign
from onboard.poi.placement.wall_line import WallLine, WallPoint
from onboard.poi.signs.number_forms import RoomNumber
from onboard.poi.signs.sign_reading import SignReading, Verdict
from onboard.poi.signs.site_numbers import PLATES_MIN, site_numbers

CAMERA = CameraModel(640, 480)
SITE = site_numbers(PoiSection())
WALL = WallLine(1.3, 0.0)
WALL_BGR, DOOR_BGR = (222, 230, 232), (62, 104, 150)
BARE = np.full((9, 9, 3), WALL_BGR, np.uint8)


def picture(*doors: tuple[int, int], light: float = 1.0) -> npt.NDArray[np.uint8]:
    """A wall with doors between columns."""
    image = np.full((480, 640, 3), WALL_BGR, np.float64)
    for left, right in doors:
        image[:, left:right] = DOOR_BGR
    noise = np.random.default_rng(1).normal(0.0, 3.0, image.shape)
    return (image * light + noise).clip(0, 255).astype(np.uint8)


def seen(detector: DoorDetector, *images: npt.NDArray[np.uint8]) -> list[DoorEdge]:
    """What the last of the pictures shows, the others seen before it."""
    edges: list[DoorEdge] = []
    for i, image in enumerate(images):
        edges = detector.edges(image, CAMERA, WALL, 0.06 * i)
    return edges


@pytest.mark.requirement("POI_MR_04")
def test_door_has_a_left_and_a_right_edge() -> None:
    edges = seen(DoorDetector(), picture(), picture((200, 500)))
    assert [(e.side, e.u_px) for e in edges] == [(Side.LEFT, 200.0), (Side.RIGHT, 500.0)]


def test_gradual_change_of_light_makes_no_door() -> None:
    lights = np.linspace(1.0, 0.6, 40)
    assert seen(DoorDetector(), *(picture(light=float(light)) for light in lights)) == []


def test_door_that_fills_the_picture_has_no_edges() -> None:
    assert seen(DoorDetector(), picture(), picture((0, 640))) == []


def test_wall_that_was_met_behind_a_door_is_taken_for_the_wall() -> None:
    edges = seen(DoorDetector(), picture((0, 640)), picture((0, 300)))
    assert [(e.side, e.u_px) for e in edges] == [(Side.RIGHT, 300.0)]


def test_calibrated_colours_find_what_lies_in_their_box() -> None:
    photo = picture((80, 560))
    box, share = calibrated_box(door_of(photo), wall_of(photo))
    assert share == 0.0
    edges = seen(DoorDetector((box,)), picture((200, 500)))
    assert [e.side for e in edges] == [Side.LEFT, Side.RIGHT]
    assert ColourBox.parse(str(box)) == box


def plain(*bgr: int) -> npt.NDArray[np.uint8]:
    return np.full((100, 100, 3), bgr, np.uint8)


def test_box_of_red_doors_wraps_the_hue() -> None:
    red = np.hstack([plain(20, 20, 200), plain(50, 20, 200)])
    box, _ = calibrated_box(red, plain(*WALL_BGR))
    assert box.low[0] > box.high[0]
    assert box.holds(np.array([[[178, 220, 200], [90, 220, 200]]], np.uint8)).tolist() == [[True, False]]


def test_a_door_of_every_hue_or_of_none_is_found_in_all_of_them() -> None:
    hues = np.linspace(0, 179, 200).astype(np.uint8)
    hsv = np.stack([hues, np.full(200, 150, np.uint8), np.full(200, 90, np.uint8)], axis=-1)
    colourful = cv2.cvtColor(np.tile(hsv, (100, 1, 1)), cv2.COLOR_HSV2BGR)
    for door in (colourful, plain(90, 91, 90)):
        box, share = calibrated_box(door, plain(*WALL_BGR))
        assert (box.low[0], box.high[0], share) == (0, 179, 0.0)


def test_the_box_is_as_wide_as_the_wall_allows() -> None:
    door, far, near = plain(100, 100, 100), plain(230, 230, 230), plain(130, 130, 130)
    wide, narrow = (calibrated_box(door, wall)[0] for wall in (far, near))
    assert wide.high[2] > narrow.high[2]
    assert not narrow.holds(cv2.cvtColor(near, cv2.COLOR_BGR2HSV)).any()
    assert calibrated_box(door, plain(101, 101, 101))[1] > WALL_SHARE_MAX


def test_specks_are_no_doors() -> None:
    door = np.zeros(640, bool)
    door[100:104] = True
    assert door_edges(door, 15.0) == []


# Records. The wall runs along x, the robot stands on its side of positive y: to the right on the wall is negative x.


def on_wall(x_m: float, y_m: float = 0.0) -> WallPoint:
    return WallPoint(x_m, y_m, pi / 2)


def records_with_door(
    centre_m: float, observations: int = 6, backed: bool = True, rises: bool | None = None
) -> DoorRecords:
    records = DoorRecords(lambda left, right: backed, SITE)
    for i in range(observations):
        records.add_edge(Side.LEFT, on_wall(centre_m + 0.5 + 0.01 * (i % 2)), float(i), rises)
        records.add_edge(Side.RIGHT, on_wall(centre_m - 0.5 + 0.01 * (i % 2)), float(i), rises)
    return records


def plate(number: str, confidence: float = 0.99, room_type: str = "") -> SignReading:
    shown = RoomNumber(number, "plain")
    return SignReading(Verdict.PLATE, shown, room_type, confidence, (0.0, 0.0, 10.0, 10.0), (number,))


def read_from(records: DoorRecords, x_m: float, reading: SignReading, *bearings_rad: float, now_s: float = 7.0) -> Sign:
    """Photos of one sign by a robot in these directions of it."""
    for bearing_rad in bearings_rad:
        sign = records.add_sign(on_wall(x_m), now_s, reading, bearing_rad)
    return sign


def other() -> SignReading:
    return SignReading(Verdict.OTHER, None, "", 0.0, (0.0, 0.0, 10.0, 10.0), ("Open day",))


def test_door_with_its_plate_beside_it_is_one_record_at_the_doors_middle() -> None:
    records = records_with_door(3.0)
    read_from(records, 2.25, plate("101", room_type="Office"), 1.4, 1.6)
    (door,) = records.doors()
    assert (door.centre.x_m, door.centre.y_m) == pytest.approx((3.005, 0.0), abs=0.01)
    assert door.state is State.READ
    assert door.sign is not None
    assert (door.sign.number, door.sign.room_type) == ("101", "Office")


def test_one_reading_is_doubtful_and_two_that_agree_are_accepted() -> None:
    records = records_with_door(3.0)
    read_from(records, 3.0, plate("101"), 1.4)
    assert records.doors()[0].state is State.DOUBTFUL
    read_from(records, 3.0, plate("107"), 1.5)
    assert records.doors()[0].state is State.DOUBTFUL
    read_from(records, 3.0, plate("101"), 1.6, 1.7)
    assert records.doors()[0].state is State.READ


@pytest.mark.parametrize(("damaged", "state"), [(1, State.DOUBTFUL), (3, State.UNREAD)])
def test_number_that_most_photos_show_damaged_is_not_shown(damaged: int, state: State) -> None:
    # A lamp's reflection hides the last letter; where it is not noticed the rest looks whole
    records = records_with_door(3.0)
    for i in range(damaged):
        part = replace(plate("137"), verdict=Verdict.UNCLEAR, reason="an edge close right", damaged=True)
        read_from(records, 2.25, part, 1.3 + 0.1 * i)
    read_from(records, 2.25, plate("137"), 1.6)
    (door,) = records.doors()
    assert door.state is state
    assert door.sign is not None
    assert door.sign.number == ("137" if state is State.DOUBTFUL else "")
    read_from(records, 2.25, plate("137"), 1.7)
    assert [(door.state, door.sign.number) for door in records.doors() if door.sign] == [(State.READ, "137")]


def test_photos_from_one_direction_are_one_view_however_many_they_are() -> None:
    records = records_with_door(3.0)
    read_from(records, 3.0, plate("324"), 1.57, 1.571, 1.569, 1.57)
    assert records.doors()[0].state is State.DOUBTFUL
    read_from(records, 3.0, plate("824"), 1.3, 1.4, 1.7)
    (door,) = records.doors()
    assert door.sign is not None
    assert (door.state, door.sign.number) == (State.READ, "824")


def test_poster_beside_a_door_is_nobodys_plate() -> None:
    records = records_with_door(3.0, rises=True)
    for _ in range(3):
        sign = records.add_sign(on_wall(2.2), 7.0, other())
    assert sign.rejected
    assert sign.settled
    assert not sign.wants_photo
    assert [door.state for door in records.doors()] == [State.UNREAD]


def test_span_without_wall_behind_it_is_no_door() -> None:
    assert records_with_door(3.0, backed=False, rises=True).doors() == []


def test_stretch_of_another_colour_that_nobody_saw_rise_is_no_door_without_a_plate() -> None:
    assert records_with_door(3.0).doors() == []
    assert records_with_door(3.0, rises=False).doors() == []
    assert [door.state for door in records_with_door(3.0, rises=True).doors()] == [State.UNREAD]


def test_door_that_was_hardly_seen_and_has_no_plate_is_left_out() -> None:
    assert records_with_door(3.0, observations=2, rises=True).doors() == []


def test_plate_goes_to_the_nearest_of_two_doors() -> None:
    records = records_with_door(3.0)
    for side, x_m in ((Side.LEFT, 1.9), (Side.RIGHT, 0.9)):
        for i in range(5):
            records.add_edge(side, on_wall(x_m), float(i))
    for x_m, number in ((2.3, "101"), (0.7, "102")):
        read_from(records, x_m, plate(number), 1.4, 1.6)
    doors = {door.sign.number: door.centre.x_m for door in records.doors() if door.sign is not None}
    assert doors == {"101": pytest.approx(3.005, abs=0.01), "102": pytest.approx(1.4, abs=0.01)}


def test_door_seen_again_after_the_map_moved_is_still_one() -> None:
    records = records_with_door(3.0, rises=True)
    for i in range(4):
        records.add_edge(Side.LEFT, on_wall(3.8, 0.1), 50.0 + i, True)
        records.add_edge(Side.RIGHT, on_wall(2.8, 0.1), 50.0 + i, True)
    assert len(records.doors()) == 1


def test_plate_of_an_unseen_door_stands_for_itself() -> None:
    records = DoorRecords(lambda left, right: True, SITE)
    read_from(records, 5.0, plate("204"), 1.4, 1.6)
    (door,) = records.doors()
    assert door.edges == ()
    assert door.centre.x_m == 5.0


def test_a_plate_where_the_map_has_no_wall_hangs_elsewhere_and_is_no_record() -> None:
    records = DoorRecords(lambda left, right: right.x_m < 4.0, SITE)
    for x_m, number in ((3.0, "203"), (5.0, "204")):
        read_from(records, x_m, plate(number), 1.4, 1.6)
    assert [door.sign.number for door in records.doors() if door.sign is not None] == ["203"]


def test_one_edge_tells_where_the_door_of_a_plate_is() -> None:
    records = DoorRecords(lambda left, right: True, SITE)
    for i in range(3):
        records.add_edge(Side.RIGHT, on_wall(5.25), float(i))
        records.add_sign(on_wall(5.0), float(i), plate("204"), 1.4 + 0.1 * i)
    (door,) = records.doors()
    assert door.centre.x_m == pytest.approx(5.25 + 0.53, abs=0.01)


def test_one_edge_leads_to_no_door_where_the_wall_ends_and_the_plates_own_rim_leads_nowhere() -> None:
    # A niche from 4.2 to 5.8 m, its plate on the leaf; right is where x falls
    records = DoorRecords(lambda left, right: right.x_m > 4.2 and left.x_m < 5.8, SITE)
    for i in range(3):
        records.add_edge(Side.LEFT, on_wall(4.5), float(i))  # seen from so near that the wall was taken for the door
        records.add_edge(Side.RIGHT, on_wall(5.08), float(i))
        records.add_sign(on_wall(5.0), float(i), plate("204"), 1.4 + 0.1 * i)
    (door,) = records.doors()
    assert door.centre.x_m == pytest.approx(5.0)


def test_jamb_of_a_plates_door_outdoes_edges_that_were_hardly_seen_beside_it() -> None:
    # The plate hangs on the leaf, whose left jamb is at 5.6 m; to the right x falls
    nowhere = Beside(left=False, right=False)
    jamb = JambView(0.0, 0.1, doubled=True, risen=False, crossed=nowhere, capped=nowhere)
    records = DoorRecords(lambda left, right: True, SITE)
    for i in range(8):
        records.add_edge(Side.LEFT, on_wall(5.62), float(i))
        records.add_jamb(jamb, on_wall(5.6), float(i))
    for i in range(2):
        records.add_edge(Side.LEFT, on_wall(6.06), float(i))
        records.add_edge(Side.RIGHT, on_wall(5.39), float(i))
    read_from(records, 5.0, plate("101"), 1.4, 1.6)
    (door,) = records.doors()
    assert door.centre.x_m == pytest.approx(5.62 - 0.53, abs=0.01)


def test_sign_that_was_never_legible_wants_a_photo() -> None:
    records = DoorRecords(lambda left, right: True, SITE)
    unclear = SignReading(Verdict.UNCLEAR, None, "", 0.0, (0.0, 0.0, 1.0, 1.0), ("3",))
    sign: Sign = records.add_sign(on_wall(5.0), 1.0, unclear)
    assert sign.wants_photo
    assert records.doors() == []


def test_outline_around_a_poster_is_no_door() -> None:
    records = records_with_door(3.0)
    for _ in range(2):
        records.add_sign(on_wall(3.3), 7.0, other())
    assert records.doors() == []


def test_a_poster_on_its_leaf_leaves_a_door_that_rises_above_it_unread() -> None:
    records = DoorRecords(lambda left, right: True, SITE)
    for i in range(6):
        records.add_edge(Side.LEFT, on_wall(3.5), float(i), None if i % 2 else True)
        records.add_edge(Side.RIGHT, on_wall(2.5), float(i), True)
    for _ in range(2):
        records.add_sign(on_wall(3.3), 7.0, other())
    assert [door.state for door in records.doors()] == [State.UNREAD]


@pytest.mark.parametrize("colours", [(), (str(calibrated_box(np.full((9, 9, 3), DOOR_BGR, np.uint8), BARE)[0]),)])
def test_edges_of_a_door_rise_above_what_hangs_on_walls_and_those_of_a_board_do_not(colours: tuple[str, ...]) -> None:
    door, board = picture((200, 500)), picture((200, 500))
    board[: round(CAMERA.row_px(1.8, WALL.distance_m))] = WALL_BGR
    boxes = tuple(ColourBox.parse(colour) for colour in colours)
    for image, rises in ((door, True), (board, False)):
        assert [edge.rises for edge in seen(DoorDetector(boxes), image)] == [rises, rises]
    near = WallLine(1.0, 0.0)  # from where the picture does not reach so high
    assert [edge.rises for edge in DoorDetector(boxes).edges(door, CAMERA, near, 0.0)] == [None, None]


def test_single_reading_of_a_number_that_another_door_has_is_dropped() -> None:
    records = records_with_door(3.0)
    read_from(records, 2.25, plate("101"), 1.4, 1.6)
    read_from(records, 9.0, plate("101"), 1.4, now_s=9.0)
    assert len(records.doors()) == 1
    read_from(records, 9.0, plate("101"), 1.6, now_s=9.5)
    assert len(records.doors()) == 2


def doubtful(number: str) -> SignReading:
    shown = RoomNumber(number, "building-room")
    return SignReading(Verdict.DOUBTFUL, shown, "", 0.99, (0.0, 0.0, 10.0, 10.0), (number,))


def test_number_of_another_form_is_doubtful_on_its_door_and_no_record_by_itself() -> None:
    records = records_with_door(3.0)
    on_door = read_from(records, 3.0, doubtful("16-101"), 1.4, 1.5, 1.6)
    read_from(records, 9.0, doubtful("16-102"), 1.4, 1.5, 1.6)
    (door,) = records.doors()
    assert door.state is State.DOUBTFUL
    assert door.sign is on_door
    assert on_door.number == "16-101"
    assert on_door.settled
    assert not on_door.wants_photo


def test_doubtful_plates_count_once_enough_of_them_share_a_form() -> None:
    records = DoorRecords(lambda left, right: True, SITE)
    for i in range(PLATES_MIN):
        assert records.doors() == []
        read_from(records, 3.0 * i, doubtful(f"16-{101 + i}"), 1.4, 1.6)
    assert sorted((door.sign.number, door.state) for door in records.doors() if door.sign is not None) == [
        (f"16-{101 + i}", State.READ) for i in range(PLATES_MIN)
    ]


def test_rooms_that_differ_only_in_separators_are_two_doors() -> None:
    records = DoorRecords(lambda left, right: True, site_numbers(PoiSection(number_presets=("floor.room",))))
    for x_m, number in ((0.0, "1.11"), (1.0, "11.1")):
        shown = RoomNumber(number, "floor.room")
        reading = SignReading(Verdict.PLATE, shown, "", 0.99, (0.0, 0.0, 10.0, 10.0), (number,))
        read_from(records, x_m, reading, 1.4, 1.6)
    assert sorted(door.sign.number for door in records.doors() if door.sign is not None) == ["1.11", "11.1"]


def row_of_plates(*numbers: str) -> DoorRecords:
    """Plates 3 m apart, each read from two directions."""
    records = DoorRecords(lambda left, right: True, SITE)
    for i, number in enumerate(numbers):
        read_from(records, 3.0 * i, plate(number), 1.4, 1.6)
    return records


@pytest.mark.parametrize(
    ("numbers", "doubted"),
    [
        (("201", "283", "205"), ["283"]),  # read for 203
        (("201", "203", "205"), []),
        (("201", "340", "205"), []),  # no number of this hall looks like it
        (("201", "283", "905"), []),  # its neighbours themselves are in no order
        (("2.01", "2.83", "2.05"), ["2.83"]),
    ],
)
def test_number_out_of_its_neighbours_order_is_doubtful_and_kept(numbers: tuple[str, ...], doubted: list[str]) -> None:
    records = row_of_plates(*numbers)
    records.doors()
    assert [sign.number for sign in records.signs] == list(numbers)
    assert [sign.number for sign in records.signs if sign.doubt] == doubted


def test_number_out_of_order_that_was_seen_from_everywhere_counts() -> None:
    records = row_of_plates("201", "283", "205")
    read_from(records, 3.0, plate("283"), 1.2, 1.8)
    records.doors()
    assert [sign.doubt for sign in records.signs] == ["", "", ""]


def test_plate_that_names_a_room_keeps_its_door_and_wants_no_photo() -> None:
    records = records_with_door(3.0)
    named = SignReading(Verdict.NAMED, None, "WOMEN", 0.0, (0.0, 0.0, 10.0, 10.0), ("WOMEN",))
    sign = read_from(records, 3.0, named, 1.4, 1.6)
    (door,) = records.doors()
    assert (door.state, sign.room_type, sign.wants_photo) == (State.UNREAD, "WOMEN", False)
