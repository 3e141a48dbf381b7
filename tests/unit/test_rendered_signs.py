"""The reader on rendered signs of every form: most are read exactly, none wrongly, and what is no plate stays none."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from offboard.evaluate.signs.fonts import DEVELOPMENT, HELD_OUT, missing
from offboard.evaluate.signs.reading import evaluated
from offboard.evaluate.signs.scenes import Kind, case, drawable
from offboard.evaluate.signs.scoring import Answer, Outcome, Result, outcome_table, reliability_table, result, shares
from offboard.evaluate.signs.texts import FORMS
from onboard.poi.signs.ocr_engine import SignReader
from onboard.poi.signs.photo_reading import PHOTO_DETECTION_SIDE_PX

QUICK = {Kind.PLATE: len(FORMS), Kind.COVERED: 12, Kind.DISTRACTOR: 12, Kind.COMPOSITE: 12, Kind.PHOTOGRAPH: 12}
ALL = {Kind.PLATE: 480, Kind.COVERED: 240, Kind.DISTRACTOR: 200, Kind.COMPOSITE: 240, Kind.PHOTOGRAPH: 560}

pytestmark = pytest.mark.skipif(
    bool(missing(DEVELOPMENT)), reason=f"fonts of rendered signs: pip install {' '.join(missing(DEVELOPMENT))}"
)


def read(counts: dict[Kind, int], fonts: Sequence[str]) -> list[Result]:
    pytest.importorskip("rapidocr")
    reader = SignReader(PHOTO_DETECTION_SIDE_PX)
    return list(evaluated((case(kind, i, fonts) for kind in drawable() for i in range(counts[kind])), reader))


def test_case_follows_from_its_seed_and_number() -> None:
    one, same = (case(Kind.COVERED, 5, DEVELOPMENT) for _ in range(2))
    assert one.number == same.number
    assert np.array_equal(one.image, same.image)
    assert not np.array_equal(one.image, case(Kind.COVERED, 5, DEVELOPMENT, seed=2).image)


def test_every_form_draws_numbers_of_its_own_pattern() -> None:
    import re
    from random import Random

    for form in FORMS:
        for seed in range(20):
            number = form.draw(Random(seed))
            assert re.fullmatch(form.pattern, number) or re.fullmatch(form.pattern, number.replace(" ", ""))


def test_outcome_of_a_case_is_by_what_counts() -> None:
    plate = case(Kind.PLATE, 0, DEVELOPMENT)
    right, wrong = Answer(plate.number, 0.99, True), Answer("999", 0.99, True)
    doubtful = Answer(plate.number, 0.6, False)
    assert result(plate, [right]).outcome is Outcome.EXACT
    assert result(plate, [wrong]).outcome is Outcome.WRONG
    assert result(plate, [right, wrong]).outcome is Outcome.WRONG
    assert result(plate, [doubtful]).outcome is Outcome.DOUBTFUL
    assert result(plate, []).outcome is Outcome.NONE
    assert result(case(Kind.DISTRACTOR, 0, DEVELOPMENT), [wrong]).outcome is Outcome.FALSE


@pytest.mark.requirement("POI_MR_02")
@pytest.mark.timeout(600)
def test_one_plate_of_every_form_is_read_and_nothing_else_is() -> None:
    results = read(QUICK, DEVELOPMENT)
    plates, covered, others, composites, photos = (shares(results, kind) for kind in Kind)
    table = "\n".join(outcome_table(results))
    assert plates[Outcome.EXACT] >= 0.85, table
    assert plates[Outcome.WRONG] <= 0.04, table
    assert covered[Outcome.WRONG] <= 0.09, table
    assert others[Outcome.FALSE] == photos[Outcome.FALSE] == 0.0, table
    assert composites[Outcome.WRONG] <= 0.09, table


@pytest.mark.slow  # 10 minutes
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("fonts", [DEVELOPMENT, HELD_OUT])
def test_plates_are_read_exactly_in_fonts_known_and_unknown(fonts: Sequence[str]) -> None:
    results = read(ALL, fonts)
    print(*outcome_table(results), *reliability_table(results), sep="\n")
    plates, covered, others, composites, photos = (shares(results, kind) for kind in Kind)
    assert plates[Outcome.EXACT] >= 0.97
    assert plates[Outcome.WRONG] <= 0.005
    assert covered[Outcome.WRONG] <= 0.01
    assert others[Outcome.FALSE] == 0.0
    assert photos[Outcome.FALSE] * ALL[Kind.PHOTOGRAPH] <= 1
    assert composites[Outcome.WRONG] <= 0.01
