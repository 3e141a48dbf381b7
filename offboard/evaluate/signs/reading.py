"""The reader of the POI module on rendered signs: cases in, what it made of each out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cache

from common.config import PoiSection
from offboard.evaluate.signs.scenes import Case
from offboard.evaluate.signs.scoring import Answer, Result, result
from onboard.poi.signs.ocr_engine import SignReader
from onboard.poi.signs.photo_reading import PHOTO_DETECTION_SIDE_PX
from onboard.poi.signs.photo_search import sign_readings
from onboard.poi.signs.sign_reading import SignRules, Verdict, sign_rules


@cache
def _rules(pattern: str) -> SignRules:
    return sign_rules(replace(PoiSection(), number_pattern=pattern))


def evaluated(cases: Iterable[Case], reader: SignReader) -> Iterator[Result]:
    """Reads each as a photo by itself, under the pattern of its form."""
    for case in cases:
        readings = sign_readings(reader, _rules(case.form.pattern), case.image, PHOTO_DETECTION_SIDE_PX)
        yield result(
            case,
            [
                Answer(reading.number.shown, reading.confidence, reading.verdict is Verdict.PLATE)
                for reading in readings
                if reading.number is not None
            ],
        )
