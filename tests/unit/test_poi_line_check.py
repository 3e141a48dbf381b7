"""What a line's strokes tell of a reading that OCR is sure of: covered, raised, faint and missing letters."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image, ImageDraw

from offboard.evaluate.signs.fonts import font_for_capitals
from onboard.poi.signs.letters import ROWS, strokes
from onboard.poi.signs.line_check import FLAT, Character, Checked, checked

CAPITAL_PX, MARGIN_PX = 30, 40
WHITE, BLACK = 235, 30


def drawn(*parts: tuple[str, float, float]) -> Any:
    """Texts on one line: each with where it begins and how far it is raised, in pixels; black on white."""
    fonts = [font_for_capitals("DejaVu Sans", CAPITAL_PX * (0.6 if raised else 1.0)) for _, _, raised in parts]
    right = max(x + font.getlength(text) for (text, x, _), font in zip(parts, fonts, strict=True))
    picture = Image.new("L", (round(right) + 9 + MARGIN_PX, CAPITAL_PX + 18 + 2 * MARGIN_PX), WHITE)
    draw = ImageDraw.Draw(picture)
    for (text, x, raised), font in zip(parts, fonts, strict=True):
        draw.text((x, MARGIN_PX + 9 - font.getbbox("H")[1] - raised), text, font=font, fill=BLACK)
    return np.asarray(picture, np.uint8).copy()


def check(picture: Any, text: str) -> Checked:
    flat = sum(c in FLAT for c in text)
    return checked(strokes(picture, MARGIN_PX, len(text.replace(" ", "")), flat), [Character(c, 0.999) for c in text])


@pytest.mark.parametrize("negative", [False, True])
@pytest.mark.parametrize("text", ["824", "16-186", "2.014", "A204", "12b", "S1|07", "111"])
def test_line_that_stands_free_has_no_damage(text: str, negative: bool) -> None:
    picture = drawn((text, 55, 0))
    result = check(255 - picture if negative else picture, text)
    assert result.damage == ""
    assert result.parts == ()
    assert result.capital * (CAPITAL_PX + 18) == pytest.approx(CAPITAL_PX, abs=2.5)


@pytest.mark.parametrize("shade", [BLACK, 120, 170])
@pytest.mark.parametrize("share", [0.35, 0.5, 0.65])
def test_first_digit_that_something_hides_in_part_is_damage(shade: int, share: float) -> None:
    picture = drawn(("824", 55, 0))
    picture[:, : round(55 + share * 0.87 * CAPITAL_PX)] = shade
    assert check(picture, "324").damage


@pytest.mark.parametrize("share", [0.3, 0.5])
def test_line_whose_lower_part_is_hidden_is_damage(share: float) -> None:
    picture = drawn(("824", 55, 0))
    picture[MARGIN_PX + 9 + round((1 - share) * CAPITAL_PX) :] = 110
    assert check(picture, "824").damage


@pytest.mark.parametrize("shade", [WHITE - 14, WHITE + 14])
@pytest.mark.parametrize("side", ["left", "right", "above", "below"])
def test_cover_nearly_of_the_plates_colour_shows_by_its_border(side: str, shade: int) -> None:
    picture = drawn(("824", 55, 0))
    ink = picture < 128
    (left, right), (top, bottom) = ((np.flatnonzero(ink.any(axis=i))[[0, -1]]) for i in (0, 1))
    hidden = {
        "left": np.s_[:, : left + 9],
        "right": np.s_[:, right - 9 :],
        "above": np.s_[: top + 9],
        "below": np.s_[bottom - 9 :],
    }[side]
    picture[hidden] = shade
    picture = np.clip(picture + np.random.default_rng(1).normal(0, 3, picture.shape), 0, 255).astype(np.uint8)
    assert check(cv2.GaussianBlur(picture, (0, 0), 1.0), "824").damage == f"an edge close {side}"


def test_room_before_a_one_is_wider_than_behind_the_last_letter_of_a_narrow_plate() -> None:
    picture = drawn(("106B", 65, 0)).astype(np.float64)
    ink = np.flatnonzero((picture < 128).any(axis=0))
    wall = picture.copy()
    wall[:] = 200
    wall[24:, ink[0] - 8 : ink[-1] + 5] = picture[24:, ink[0] - 8 : ink[-1] + 5]
    assert check(cv2.GaussianBlur(wall, (0, 0), 0.8).astype(np.uint8), "106B").damage == ""


@pytest.mark.parametrize("text", ["1/45A", "1/19"])
@pytest.mark.parametrize("room", [0.07, 0.12, 0.17])
def test_digits_of_one_width_stand_in_the_middle_of_a_plate_though_the_ink_of_the_one_does_not(
    text: str, room: float
) -> None:
    picture = drawn((text, 65, 0))
    begins, ends = 65, 65 + round(font_for_capitals("DejaVu Sans", CAPITAL_PX).getlength(text))
    out = round(room * CAPITAL_PX)
    picture[:, : begins - out] = picture[:, ends + out :] = 150
    assert check(cv2.GaussianBlur(picture, (0, 0), 0.6), text).damage == ""


@pytest.mark.parametrize("gap_px", [3, 4, 6])
def test_border_of_a_plate_close_above_a_whole_number_is_no_damage(gap_px: int) -> None:
    picture = drawn(("108B", 65, 0))
    ink = np.flatnonzero((picture < 128).any(axis=1))
    picture[: ink[0] - gap_px] = 90
    assert check(cv2.GaussianBlur(picture, (0, 0), 0.6), "108B").damage == ""


@pytest.mark.parametrize("text", ["112B", "125", "12"])
def test_letters_of_a_dark_plate_are_found_though_the_box_reaches_its_brighter_wall(text: str) -> None:
    picture = 255 - drawn((text, 65, 0))
    ink = np.flatnonzero((picture > 128).any(axis=1))
    picture[: ink[0] - 6] = 228
    picture[ink[-1] + 7 :] = 228
    result = check(picture, text)
    assert result.damage == ""
    assert result.capital * (CAPITAL_PX + 18) == pytest.approx(CAPITAL_PX, abs=2.5)


def test_cover_that_lies_askew_on_a_line_is_seen_on_both_sides_of_it() -> None:
    picture = drawn(("66", 55, 0))
    ink = np.flatnonzero((picture < 128).any(axis=1))
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]]
    picture[y < ink[0] + 7 + 0.08 * (x - 80)] = 150
    assert check(cv2.GaussianBlur(picture, (0, 0), 1.0), "00").damage == "an edge close above"


@pytest.mark.parametrize("slope", [-0.04, 0.04])
def test_cover_of_a_long_number_that_hides_more_of_one_end_is_seen(slope: float) -> None:
    picture = drawn(("C31169", 55, 0))
    ink = np.flatnonzero((picture < 128).any(axis=1))
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]]
    picture[y > (ink[0] + ink[-1]) / 2 + slope * (x - picture.shape[1] / 2)] = WHITE - 40
    assert check(cv2.GaussianBlur(picture, (0, 0), 1.0), "C21169").damage == "an edge close below"


@pytest.mark.parametrize(
    ("above_px", "below_px", "negative"), [(4, 9, True), (4, 30, True), (6, 3, False), (6, 6, True)]
)
def test_letters_are_found_whatever_is_beyond_a_narrow_plate(above_px: int, below_px: int, negative: bool) -> None:
    picture = drawn(("11-109", 65, 0))
    ink = np.flatnonzero((picture < 128).any(axis=1))
    picture[: ink[0] - above_px] = picture[ink[-1] + 1 + below_px :] = 150
    result = check(255 - picture if negative else picture, "11-109")
    assert result.damage == ""
    assert result.capital * (CAPITAL_PX + 18) == pytest.approx(CAPITAL_PX, abs=2.5)


def test_dash_before_a_number_that_was_not_read_is_damage() -> None:
    picture = drawn(("-6.96", 65, 0))
    assert check(picture, "-6.96").damage == ""
    assert check(picture, "6.96").damage == "a dash that was not read"


def test_letters_much_lower_than_their_box_are_to_be_read_in_one_that_fits() -> None:
    font = font_for_capitals("DejaVu Sans", 12)
    picture = Image.new("L", (200, 48 + 2 * MARGIN_PX), WHITE)
    ImageDraw.Draw(picture).text((60, MARGIN_PX + 20 - font.getbbox("H")[1]), "-6.96", font=font, fill=BLACK)
    top, bottom = check(np.asarray(picture, np.uint8), "6.96").rows
    assert 0.2 < top < 20 / 48
    assert 32 / 48 < bottom < 0.9
    assert check(drawn(("824", 55, 0)), "824").rows == (0.0, 1.0)


def test_light_that_falls_on_one_end_of_a_number_is_no_border() -> None:
    picture = drawn(("824", 55, 0)).astype(np.float64)
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]]
    spot = np.clip(1.6 - np.hypot(x - 130, y - 64) / 40, 0, 1)
    assert check((0.7 * picture + 0.3 * spot * (250 - picture)).astype(np.uint8), "824").damage == ""


@pytest.mark.parametrize("negative", [False, True])
@pytest.mark.parametrize(
    ("left_px", "right_px", "damage"), [(5, 5, False), (5, 60, True), (60, 5, True), (-9, -9, True)]
)
def test_a_number_that_fills_a_narrow_plate_is_whole_and_one_with_a_border_on_one_side_is_not(
    left_px: int, right_px: int, damage: bool, negative: bool
) -> None:
    picture = drawn(("214B", 65, 0))
    ink = np.flatnonzero((picture < 128).any(axis=0))
    picture[:, : ink[0] - left_px] = 130
    picture[:, ink[-1] + 1 + right_px :] = 130
    assert bool(check(255 - picture if negative else picture, "214B").damage) == damage


@pytest.mark.parametrize("aside_px", range(3, 15))
def test_borders_of_a_narrow_plate_are_alike_wherever_the_limit_between_near_and_far_is(aside_px: int) -> None:
    picture = drawn(("214B", 65, 0))
    ink = np.flatnonzero((picture < 128).any(axis=0))
    picture[:, : ink[0] - aside_px] = 60
    picture[:, ink[-1] + 2 + aside_px :] = 60
    soft = cv2.GaussianBlur(picture, (0, 0), 1.5)
    assert check(soft, "214B").damage == ""


def test_room_between_a_word_and_its_number_is_no_gap_but_behind_a_dot_between_digits_it_is() -> None:
    assert check(drawn(("No.", 55, 0), ("848", 152, 0)), "No.848").damage == ""
    assert check(drawn(("4.", 55, 0), ("84", 114, 0)), "4.84").damage == "a gap between the letters"


def test_raised_digit_is_damage() -> None:
    assert check(drawn(("10", 55, 0), ("2", 112, 4)), "102").damage


def test_letter_that_light_erased_is_missed() -> None:
    picture = drawn(("5", 45, 0), ("34", 95, 0))
    assert check(picture, "534").damage == "a gap between the letters"
    assert check(picture, "5 34").damage == ""


def test_light_that_falls_on_a_plate_is_no_damage() -> None:
    picture = drawn(("824", 55, 0)).astype(np.float64)
    light = np.linspace(0.45, 1.0, picture.shape[1])[None, :]
    assert check((picture * light).astype(np.uint8), "824").damage == ""


def test_cable_across_the_letters_is_damage() -> None:
    picture = drawn(("824", 55, 0))
    picture[:, 80:86] = BLACK
    assert check(picture, "824").damage


def test_pictogram_beside_the_number_is_parted_from_it() -> None:
    picture = drawn(("214", 95, 0))
    picture[MARGIN_PX : MARGIN_PX + CAPITAL_PX + 17, 50:70] = BLACK
    (part,) = check(picture, "0214").parts
    assert 0.2 < part[0] < 0.4
    assert part[1] > 0.9


def test_name_far_beside_the_number_is_parted_from_it() -> None:
    assert len(check(drawn(("214", 50, 0), ("Osei", 170, 0)), "214 Osei").parts) == 2


def test_blank_line_has_no_strokes() -> None:
    result = check(np.full((100, 200), 128, np.uint8), "8")
    assert (result.capital, result.damage) == (0.0, "no strokes")
    assert ROWS > 0
