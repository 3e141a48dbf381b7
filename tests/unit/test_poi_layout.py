"""Plate or poster by its arrangement: names as tall as the number, numbers on two lines, slanted and steep text."""

from __future__ import annotations

from dataclasses import replace
from math import pi, radians

import pytest

from common.config import PoiSection
from onboard.poi.signs.grouping import rows_of, signs
from onboard.poi.signs.sign_reading import SignReading, SignRules, Verdict, sign_rules
from onboard.poi.signs.sign_words import is_name, is_notice, is_service
from onboard.poi.signs.text_line import TextLine, box_of

PLAIN = sign_rules(PoiSection())
BUILDING_ROOM = sign_rules(replace(PoiSection(), number_presets=("building-room",)))
HIGH_PX = 40.0
LEFT_PX = 300.0

Part = tuple[str, float]  # text, height of its capitals over the number's


def line(text: str, share: float = 1.0, y_px: float = 200.0, x_px: float = LEFT_PX, damage: str = "") -> TextLine:
    """A level line whose box is 1.5 times as high as its capitals."""
    high = share * HIGH_PX
    return TextLine(text, 0.99, x_px, y_px, 0.62 * high * len(text), 1.5 * high, 0.0, high, damage)


def stacked(*parts: Part) -> list[TextLine]:
    """Lines below one another, a pitch of 1.8 capitals apart."""
    pitches = [1.8 * share * HIGH_PX for _, share in parts]
    return [line(text, share, 200.0 + sum(pitches[:i])) for i, (text, share) in enumerate(parts)]


def judged(lines: list[TextLine], rules: SignRules = PLAIN) -> SignReading:
    """What the rules make of it, as one sign, which the lines must be."""
    (sign,) = signs(lines)
    return rules.judge(sign)


def shown(reading: SignReading) -> str:
    return reading.number.shown if reading.number is not None and reading.verdict is Verdict.PLATE else ""


def test_words_of_small_lines_that_were_read_one_by_one_are_no_more_lines() -> None:
    names = [("Dr.", "A.", "Keller"), ("Prof.", "M.", "Lindqvist"), ("Ms.", "E.", "Novak")]
    words = [
        line(word, 0.5, 270.0 + 36.0 * row, LEFT_PX + 60.0 * column)
        for row, name in enumerate(names)
        for column, word in enumerate(name)
    ]
    assert shown(judged([line("214"), *words])) == "214"
    notes = [line("in any case", 0.4, 270.0 + 28.0 * row) for row in range(9)]
    assert judged([line("214"), *notes]).reason == "too many lines"


@pytest.mark.parametrize(
    "parts",
    [
        [("214", 1.0)],
        [("214", 1.0), ("Office", 0.5)],
        [("214", 1.0), ("Dr. A. Keller", 1.0)],
        [("M. Osei", 1.0), ("214", 1.0)],
        [("WOMEN", 1.0), ("214", 1.0)],
        [("Meeting Room", 1.2), ("214", 1.0)],
        [("214", 1.0), ("J. Park", 0.5), ("S. Rahman", 0.5), ("Prof. Lindqvist", 0.5), ("Tel. 4711", 0.4)],
        [("214 Smith", 1.0)],
        [("STAIRS 214", 1.0)],
        [("Lab 214", 1.0)],
    ],
)
@pytest.mark.parametrize("slant_deg", [0, 14, -20])
def test_plate_holds_one_number_however_it_is_arranged_and_seen(parts: list[Part], slant_deg: float) -> None:
    slanted = [one.turned(radians(-slant_deg)) for one in stacked(*parts)]
    assert shown(judged(slanted)) == "214"


def test_name_on_the_numbers_row_stands_apart_from_it() -> None:
    assert shown(judged([line("214"), line("B. O'Neill", x_px=LEFT_PX + 140)])) == "214"


@pytest.mark.parametrize(
    ("upper", "lower", "number"), [("16", "186", "16-186"), ("E14", "633", "E14-633"), ("3-", "101A", "3-101A")]
)
def test_number_on_two_lines_is_one(upper: str, lower: str, number: str) -> None:
    assert shown(judged(stacked((upper, 1.0), (lower, 1.0)), BUILDING_ROOM)) == number


def test_number_far_apart_on_one_row_is_one() -> None:
    assert shown(judged([line("E25 /"), line("125", x_px=LEFT_PX + 180)], sign_rules(
        replace(PoiSection(), number_presets=("floor/room",))
    ))) == "E25/125"  # fmt: skip


@pytest.mark.parametrize(
    "parts",
    [
        [("← 243-259", 1.0)],
        [("Offices", 1.0), ("214", 1.0)],
        [("214", 1.0), ("216", 1.0), ("218", 1.0)],
        [("In case of fire", 1.0), ("214", 1.0)],
        [("Course 214", 1.0), ("begins 3 May", 1.0)],
        [("Concert", 2.0), ("214", 1.0)],
        [("214 €", 1.0)],
        [("please use the other door", 1.0), ("214", 1.0)],
        [("Platform 214", 1.0)],
        [("Bus 214 Airport", 1.0)],
    ],
)
def test_what_says_more_than_a_plate_is_none(parts: list[Part]) -> None:
    reading = judged(stacked(*parts))
    assert reading.verdict is Verdict.OTHER
    assert reading.reason or reading.number is None


def test_line_that_something_hides_is_no_reading_but_worth_another_photo() -> None:
    reading = judged([line("324", damage="an edge close left")])
    assert (reading.verdict, reading.reason) == (Verdict.UNCLEAR, "an edge close left")


@pytest.mark.parametrize(
    ("text", "room_type"),
    [("MEN", "MEN"), ("STAIR", "Stairs"), ("HERREN", "HERREN"), ("女子", "女子"), ("Kitchen", "Kitchen")],
)
def test_plate_without_a_number_names_its_room(text: str, room_type: str) -> None:
    reading = judged([line(text)])
    assert (reading.verdict, reading.room_type) == (Verdict.NAMED, room_type)


def test_steep_text_beside_level_text_is_another_sign() -> None:
    steep = replace(line("EXIT", x_px=LEFT_PX + 60), angle_rad=pi / 2)
    assert len(signs([line("214"), steep])) == 2


def test_line_keeps_its_corners_through_box_and_angle() -> None:
    slanted = replace(line("214"), angle_rad=0.3)
    x, y, width, height, angle = box_of(slanted.corners)
    assert (x, y, width, height, angle) == pytest.approx(
        (slanted.x_px, slanted.y_px, slanted.width_px, slanted.height_px, 0.3), abs=1e-3
    )


def test_confidence_of_a_number_is_that_of_its_own_letters() -> None:
    named = replace(line("214 Lindqvist"), confidence=0.4, certain=(0.99, 0.98, 0.97, *[0.4] * 9))
    assert named.confidence_of("214") == 0.97
    assert named.confidence_of("999") == 0.4


def test_rows_of_a_slanted_sign_are_found_in_its_own_direction() -> None:
    slanted = [
        one.turned(radians(-25)) for one in (line("214"), line("Smith", x_px=LEFT_PX + 150), line("Office", y_px=272.0))
    ]
    assert [[one.text for one in row] for row in rows_of(slanted)] == [["214", "Smith"], ["Office"]]


def test_words_of_signs() -> None:
    assert all(map(is_service, ("Women", "HERREN", "stair", "Escalier", "화장실")))
    assert all(map(is_notice, ("Notausgang", "→", "50 %", "Opening hours")))
    assert all(map(is_name, ("Dr. A. Keller", "Lindqvist", "Institut für Physik")))
    assert not any(map(is_name, ("all rights reserved", "214", "Opens at 9")))
