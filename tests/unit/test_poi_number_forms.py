"""Room numbers by the site's forms: what a line of text becomes, and what it never becomes."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.config import PoiSection
from common.number_presets import PRESETS
from common.room_number import key_of, plain
from offboard.simulator.building.floor import Plate
from offboard.simulator.camera.sign_textures import draw_plate
from onboard.poi.signs.grouping import signs
from onboard.poi.signs.number_forms import NumberForms, RoomNumber, site_forms
from onboard.poi.signs.ocr_engine import SignReader
from onboard.poi.signs.sign_reading import Verdict, sign_rules
from onboard.poi.signs.site_numbers import BACKING_MIN, PLATES_MIN, SiteNumbers, site_numbers
from onboard.poi.signs.text_line import TextLine

PLAIN = site_forms(PoiSection())


def at_site(*presets: str) -> NumberForms:
    return site_forms(PoiSection(number_presets=presets))


@cache
def sign_reader() -> SignReader:
    return SignReader()


def shown(forms: NumberForms, line: str) -> str:
    """The number that counts by itself, empty when there is none."""
    number = forms.match(line)
    return number.shown if number is not None and forms.counts(number) else ""


@pytest.mark.parametrize(
    ("preset", "line", "number"),
    [
        ("plain", "501", "501"),
        ("plain", "2041", "2041"),
        ("plain", "215B", "215B"),
        ("plain", "215 b", "215b"),
        ("plain", "204SC", "204SC"),
        ("plain", "007a", "007a"),
        ("plain", "Raum 214", "214"),
        ("plain", "RAUM: 214", "214"),
        ("plain", "Room No. 214", "214"),
        ("plain", "No. 214", "214"),
        ("plain", "№214", "214"),
        ("plain", "#214", "214"),
        ("plain", "Office 214", "214"),
        ("plain", "214 Office", "214"),
        ("plain", "501호", "501"),
        ("plain", "501 호실", "501"),
        ("plain", "501室", "501"),
        ("plain", "５０１号室", "501"),
        ("plain", "第501室", "501"),
        ("plain", "1O1", "101"),
        ("plain", "I2O", "120"),
        ("plain", "5O1", "501"),
        ("short", "7", "7"),
        ("short", "12b", "12b"),
        ("short", "Room 3", "3"),
        ("short", "WC 012", ""),
        ("letter-prefix", "A204", "A204"),
        ("letter-prefix", "A 204", "A204"),
        ("letter-prefix", "a2O4", "A204"),
        ("letter-prefix", "ITB119", "ITB119"),
        ("letter-prefix", "#A204", "A204"),
        ("letter-prefix", "LAB204", "LAB204"),
        ("letter-prefix", "Lab A204", "A204"),
        ("floor.room", "2.01", "2.01"),
        ("floor.room", "-1.05", "-1.05"),
        ("floor.room", "−1.05", "-1.05"),
        ("floor.room", "U1.03", "U1.03"),
        ("floor.room", "10.5", "10.5"),
        ("floor.room", "2·O1", "2.01"),
        ("floor.room", "2,01", "2.01"),
        ("floor/room", "2/14", "2/14"),
        ("floor/room", "2 / 14", "2/14"),
        ("floor/room", "B/12", "B/12"),
        ("building-room", "16-186", "16-186"),
        ("building-room", "16 – 186", "16-186"),
        ("building-room", "16-1B6", "16-186"),
        ("building-room", "E14-633", "E14-633"),
        ("building-room", "E14-6S3", "E14-653"),
        ("building-room", "3-101A", "3-101A"),
        ("building-room", "O-101", "O-101"),
        ("building-room", "E25 143", "E25 143"),
        ("building-room", "204 206", ""),
        ("building-floor-room", "A-2-14", "A-2-14"),
        ("building-floor-room", "A-2-I4", "A-2-14"),
        ("building-floor-room", "12-3-104", "12-3-104"),
        ("building.floor.room", "B.2.017", "B.2.017"),
        ("building.floor.room", "8.2.017", "8.2.017"),
        ("building|room", "S1|07", "S1|07"),
        ("building|room", "S1│07", "S1|07"),
        ("building|room", "S1I07", "S1|07"),
        ("building|room", "S9103", "S9|03"),
        ("building|room", "51|O7", "S1|07"),
    ],
)
def test_number_is_shown_as_on_its_plate(preset: str, line: str, number: str) -> None:
    assert shown(at_site(preset), line) == number


@pytest.mark.parametrize("preset", PRESETS)
def test_examples_of_every_preset_are_of_its_form(preset: str) -> None:
    forms = at_site(preset)
    assert [shown(forms, example) for example in PRESETS[preset].examples] == list(PRESETS[preset].examples)


@pytest.mark.parametrize("preset", PRESETS)
def test_drawn_plates_of_every_form_are_read(preset: str) -> None:
    pytest.importorskip("rapidocr")
    reader, rules = sign_reader(), sign_rules(PoiSection(number_presets=(preset,)))
    for number in PRESETS[preset].examples:
        plate = draw_plate(Plate(0.0, 0.0, False, 1.5, 0.25, 0.15, 0.035, "light on dark"), number, "Office")
        rows = np.ascontiguousarray(np.asarray(plate)[..., ::-1])
        wall = cv2.copyMakeBorder(rows, 80, 80, 80, 80, cv2.BORDER_CONSTANT, value=(220, 226, 230))
        photo = np.asarray(cv2.resize(wall, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.uint8)
        (reading,) = (rules.judge(lines) for lines in signs(reader.lines(photo)))
        assert reading.verdict is Verdict.PLATE
        assert reading.number is not None
        assert (reading.number.shown, reading.number.form, reading.room_type) == (number, preset, "Office")


def test_a_site_may_have_several_forms() -> None:
    forms = at_site("plain", "building|room", "floor.room")
    lines = ("501", "S1|07", "2.01", "16-186")
    assert [shown(forms, line) for line in lines] == ["501", "S1|07", "2.01", ""]


@pytest.mark.parametrize(
    "line",
    [
        *("2019", "1998", "112", "230V", "400 V", "100mm", "12.30", "12:30", "9-17", "24/7", "253-260", "101 – 140"),
        *("905 525 9140", "555-1234", "0800 123", "Call 5500", "12.05.26", "€ 12", "12.50 €", "INV 004711", "0047112"),
        *("Fax 5500", "Mo-Fr 9-17", "3 × 4", "16A", "20:15", "Level 2", "FIRE EXIT", "204 206", "10²", "204½", ""),
    ],
)
def test_what_is_no_room_by_default(line: str) -> None:
    assert shown(PLAIN, line) == ""


@pytest.mark.parametrize(
    ("text", "what"), [("12.30", "a time"), ("253-260", "a range of rooms"), ("9-17", "opening hours")]
)
def test_sign_that_is_legible_and_no_plate_wants_no_other_photo(text: str, what: str) -> None:
    reading = sign_rules(PoiSection()).judge([TextLine(text, 0.99, 100.0, 200.0, 25.0 * len(text), 40.0)])
    assert (reading.verdict, reading.reason) == (Verdict.OTHER, f"may be {what}")


@pytest.mark.parametrize(
    ("preset", "line"),
    [
        ("building-room", "253-260"),
        ("building-room", "9-17"),
        ("building-room", "555-1234"),
        ("floor.room", "12.30"),
        ("floor/room", "24/7"),
        ("building-floor-room", "12-05-26"),
        ("building.floor.room", "12.05.26"),
    ],
)
def test_what_is_no_room_even_where_its_form_is_the_sites(preset: str, line: str) -> None:
    assert shown(at_site(preset), line) == ""


@pytest.mark.parametrize("line", ["2019", "112", "230V", "12.30", "9-17", "253-260"])
def test_pattern_that_a_site_wrote_is_not_suspected(line: str) -> None:
    forms = site_forms(PoiSection(number_pattern="[0-9]{1,4}[-.]?[0-9]{0,3}V?"))
    assert shown(forms, line) == line


@pytest.mark.parametrize(
    ("pattern", "line", "number"),
    [
        ("[A-Z]-[0-9]{3}", "0-101", "O-101"),
        ("[A-Z]-[0-9]{3}", "1-101", "I-101"),
        ("[A-Z]-[0-9]{3}", "5-1O1", "S-101"),
        ("[A-Z]-[0-9]{3}", "8-1B1", "B-181"),
        ("[A-Z][0-9]{3}", "A-204", ""),
        ("[A-Z0-9]-[0-9]{3}", "0-101", "0-101"),
        ("[A-Z0-9]-[0-9]{3}", "O-101", "O-101"),
        ("[0-9]{3,4}[A-Z]?", "204S", "204S"),
        ("[0-9]{4}", "204S", "2045"),
        ("[0-9]{3}[A-Z]", "2045", "204S"),
        ("[0-9]{2}[.][0-9]{2} [0-9]", "10.20 3", "10.20 3"),
        (r"\d\.\d\d[a-z]", "1.05B", "1.05b"),
    ],
)
def test_letters_and_digits_are_exchanged_where_the_form_wants_it(pattern: str, line: str, number: str) -> None:
    assert shown(site_forms(PoiSection(number_pattern=pattern)), line) == number


def test_suffix_of_two_letters_loses_none_to_the_digits() -> None:
    number = site_forms(PoiSection(number_pattern="[0-9]{3,4}[A-Z]?")).match("204SC")
    assert number is not None
    assert number.shown == "204SC"


def test_space_that_the_engine_overlooked_is_found_where_only_one_place_makes_a_number() -> None:
    forms = site_forms(PoiSection(number_pattern="[0-9]{2} [0-9]{3}"))
    number = forms.match("21269")
    assert number is not None
    assert (number.shown, number.key, number.repairs) == ("21 269", "21 269", 1)
    assert forms.match("212697") is None
    either = site_forms(PoiSection(number_pattern="[0-9]{2} [0-9]{3}|[0-9]{3} [0-9]{2}"))
    assert either.match("21269") is None


def test_number_of_another_form_is_not_parted_to_be_of_the_sites() -> None:
    number = at_site("building-room").match("A2043")
    assert number is not None
    assert (number.shown, number.form) == ("A2043", "letter-prefix")


def test_bar_that_was_read_as_a_digit_is_found_where_only_one_digit_may_be_it() -> None:
    number = at_site("building|room").match("S1117")
    assert number is None or number.form != "building|room"


def test_site_without_repairs_takes_what_was_read() -> None:
    forms = site_forms(PoiSection(number_repairs=()))
    assert forms.match("1O1") is None


def test_form_that_could_mean_two_numbers_means_none() -> None:
    forms = site_forms(PoiSection(number_pattern="[0-9]{2}|[A-Z]{2}", number_repairs=("O<>0", "Q<>0")))
    assert shown(forms, "1O") == "10"
    ambiguous = site_forms(PoiSection(number_pattern="[OQ]-[0-9]", number_repairs=("O<>0", "Q<>0")))
    assert shown(ambiguous, "0-1") == ""


@pytest.mark.timeout(20)
@pytest.mark.parametrize("pattern", ["(A+)+!", "((A+)+)+!", "(A|AA)+!", "(A*)*(A*)*!", "(I+1*)+!", "([I1]+)+!"])
def test_pattern_whose_time_doubles_with_every_letter_does_not_hold_up_the_reading(pattern: str) -> None:
    forms = site_forms(PoiSection(number_pattern=pattern))
    lines = [letter * length for letter in "AI1" for length in (11, 12, 13, 300)]
    assert [shown(forms, line) for line in lines] == [""] * len(lines)


# Keys

ROOMS = st.from_regex("|".join(f"(?:{preset.pattern})" for preset in PRESETS.values()), fullmatch=True)


def letters_of(number: str) -> str:
    return "".join(filter(str.isalnum, number.upper()))


@given(ROOMS, ROOMS)
def test_rooms_that_differ_only_in_separators_share_no_key(one: str, other: str) -> None:
    assert (key_of(one) == key_of(other)) == (plain(one).upper() == plain(other).upper())


@given(st.text("0123456789", min_size=2, max_size=6), st.text(".-/| ", min_size=1, max_size=1), st.data())
def test_place_of_the_separator_makes_another_key(digits: str, separator: str, data: st.DataObject) -> None:
    places = st.integers(1, len(digits) - 1)
    i, j = data.draw(places), data.draw(places)
    one, other = (digits[:place] + separator + digits[place:] for place in (i, j))
    assert (key_of(one) == key_of(other)) == (i == j)
    assert key_of(digits) not in (key_of(one), key_of(other))


@given(st.text(max_size=20))
def test_key_of_a_key_is_that_key(text: str) -> None:
    assert key_of(key_of(text)) == key_of(text)


@given(ROOMS)
def test_either_form_written_by_hand_has_the_same_key(number: str) -> None:
    assert key_of(f" {number.lower()} ") == key_of(key_of(number)) == key_of(number)


@given(st.one_of(st.text(max_size=12), st.text("0123456789OISBZ.-/| A", max_size=10)), st.sampled_from([*PRESETS]))
def test_number_is_of_the_form_that_it_names_and_has_the_letters_that_were_read(line: str, preset: str) -> None:
    forms = at_site(preset)
    number = forms.match(line)
    if number is not None:
        assert (forms.own | forms.foreign)[number.form].fullmatch(number.shown)
        if not number.repairs and not number.words:
            assert letters_of(number.shown) == letters_of(plain(line))


# What counts at a site


def room(number: str, form: str = "building-room", suspicion: str = "") -> RoomNumber:
    return RoomNumber(number, form, suspicion=suspicion)


def test_form_that_most_plates_share_is_learned_where_the_site_names_none() -> None:
    plates = [room(f"16-{n}") for n in range(101, 101 + PLATES_MIN)]
    site = site_numbers(PoiSection())
    assert site.after(plates[:-1]).doubt(plates[0])
    known = site.after([*plates, room("205", "plain"), room("12.30", "floor.room", "a time")])
    assert known.proposed == "building-room"
    assert [known.doubt(plate) for plate in plates] == [""] * PLATES_MIN
    assert known.doubt(room("12.30", "floor.room", "a time"))


def test_form_of_a_minority_is_not_learned() -> None:
    plates = [room(f"16-{n}") for n in range(101, 101 + PLATES_MIN)]
    plain_plates = [room(str(n), "plain") for n in range(201, 201 + PLATES_MIN)]
    assert site_numbers(PoiSection()).after(plates + plain_plates).proposed == ""


def test_site_that_names_its_forms_keeps_to_them() -> None:
    plates = [room(f"16-{n}") for n in range(101, 101 + PLATES_MIN)]
    site = site_numbers(PoiSection(number_presets=("plain",))).after(plates)
    assert site.proposed == "building-room"
    assert site.doubt(plates[0]) == "the site's numbers are not building-room"


@pytest.mark.parametrize("pattern", ["", "[A-Z]?[0-9]{3}"])
@pytest.mark.parametrize(("text", "counts"), [("000", False), ("O00", False), ("100", True), ("008", True)])
def test_buttons_and_coins_in_a_row_are_no_number(pattern: str, text: str, counts: bool) -> None:
    forms = site_forms(PoiSection(number_pattern=pattern))
    number = forms.match(text)
    assert number is not None
    assert forms.counts(number) is counts


def test_year_counts_among_rooms_of_its_hundred() -> None:
    room_2019 = room("2019", "plain", "a year")
    neighbours = [room(f"20{n}", "plain") for n in range(50, 50 + BACKING_MIN)]
    site = SiteNumbers(frozenset({"plain"}), named=False)
    assert site.after([room_2019, *neighbours[1:]]).doubt(room_2019) == "may be a year"
    assert site.after([room_2019, *neighbours]).doubt(room_2019) == ""
