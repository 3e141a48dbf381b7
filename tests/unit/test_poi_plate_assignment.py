"""Which plate is which door's, where several are in reach or hang side by side."""

from __future__ import annotations

from math import pi

import pytest

from common.config import PoiSection
from onboard.poi.doors.door_association import State
from onboard.poi.doors.door_detection import Side
from onboard.poi.doors.door_records import DoorRecords
from onboard.poi.doors.plate_assignment import HABIT_MIN
from onboard.poi.placement.wall_line import WallPoint
from onboard.poi.signs.number_forms import RoomNumber
from onboard.poi.signs.sign_reading import SignReading, Verdict
from onboard.poi.signs.site_numbers import site_numbers

HALF_M = 0.5  # of a door with its frame
BEARINGS = (1.3, 1.45, 1.6)


class Hall:
    """A wall along x that a robot on its side of positive y looks at: places count to the right as one looks."""

    def __init__(self) -> None:
        self.records = DoorRecords(lambda left, right: True, site_numbers(PoiSection()))

    def door(self, at_m: float) -> None:
        for i in range(5):
            self.records.add_edge(Side.LEFT, self.point(at_m - HALF_M), float(i))
            self.records.add_edge(Side.RIGHT, self.point(at_m + HALF_M), float(i))

    def plates(self, **at_m: float) -> None:
        """Photos from three directions that show all of these plates at once, `n237=1.2` for 237."""
        for bearing_rad in BEARINGS:
            seen = [(self.point(x_m), reading(name[1:]), bearing_rad) for name, x_m in at_m.items()]
            self.records.add_photo(seen, 7.0)

    def numbers(self) -> dict[str, float]:
        """Places of the doors that were read, by number."""
        return {
            door.sign.number: pytest.approx(-door.centre.x_m, abs=0.02)
            for door in self.records.doors()
            if door.sign is not None and door.state is State.READ
        }

    @staticmethod
    def point(right_m: float) -> WallPoint:
        return WallPoint(-right_m, 0.0, pi / 2)


def reading(number: str) -> SignReading:
    shown = RoomNumber(number, "plain")
    return SignReading(Verdict.PLATE, shown, "", 0.99, (0.0, 0.0, 10.0, 10.0), (number,))


def test_two_plates_that_one_photo_shows_side_by_side_are_two_doors() -> None:
    hall = Hall()
    hall.door(0.0)
    hall.door(1.72)
    hall.plates(n236A=0.70, n237=0.93)
    assert hall.numbers() == {"236A": 0.0, "237": 1.72}


def test_plate_that_is_seen_alone_first_keeps_its_place_when_its_neighbour_comes_into_view() -> None:
    hall = Hall()
    hall.door(0.0)
    hall.door(1.72)
    hall.plates(n236A=0.70)
    hall.plates(n237=0.93)  # taken for the first, which is near
    hall.plates(n236A=0.70, n237=0.93)
    hall.plates(n237=0.93)
    assert hall.numbers() == {"236A": 0.0, "237": 1.72}


def test_misread_letter_of_one_plate_makes_no_second_plate() -> None:
    hall = Hall()
    hall.door(0.0)
    hall.plates(n824=0.70)
    hall.records.add_photo([(hall.point(0.72), reading("324"), 1.2)], 8.0)
    assert hall.numbers() == {"824": 0.0}
    assert len(hall.records.signs) == 1


def test_doors_in_reach_of_two_plates_get_one_each_in_their_order() -> None:
    hall = Hall()
    hall.door(0.0)
    hall.door(1.6)
    hall.plates(n101=0.95, n102=1.05)  # both nearer to the second door
    assert hall.numbers() == {"101": 0.0, "102": 1.6}


def row_with_plates_on_the_right() -> Hall:
    """Doors far apart that leave no choice."""
    hall = Hall()
    for i in range(HABIT_MIN):
        hall.door(10.0 + 4.0 * i)
        hall.plates(**{f"n{301 + i}": 10.9 + 4.0 * i})
    return hall


def test_side_on_which_plates_hang_at_a_site_decides_between_two_doors() -> None:
    for hall, owner_m in ((Hall(), 1.6), (row_with_plates_on_the_right(), 0.0)):
        hall.door(0.0)
        hall.door(1.6)
        hall.plates(n101=0.85)  # 0.35 m from the first door, 0.25 m from the second
        assert hall.numbers()["101"] == owner_m


def test_plate_on_the_unusual_side_of_a_door_that_stands_alone_is_its_plate_all_the_same() -> None:
    hall = row_with_plates_on_the_right()
    hall.door(0.0)
    hall.plates(n101=-0.7)
    assert hall.numbers()["101"] == 0.0
