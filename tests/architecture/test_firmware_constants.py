"""The firmware's copies of the robot's numbers are the numbers of common/constants.py."""

from __future__ import annotations

import math
import re

import pytest

from common import constants
from tests.architecture.project import ROOT

CONFIG = ROOT / "arduino" / "indoor_mapping" / "src" / "config.h"
COPY = re.compile(r"(?P<name>k\w+)\s*=\s*(?P<value>-?\d+);\s*//\s*=\s*(?P<expression>[\w .*/()+-]+)$", re.MULTILINE)

COPIES = [match.groups() for match in COPY.finditer(CONFIG.read_text(encoding="utf-8"))] if CONFIG.exists() else []


@pytest.mark.parametrize(("name", "value", "expression"), COPIES, ids=[copy[0] for copy in COPIES])
def test_firmware_has_the_same_number(name: str, value: str, expression: str) -> None:
    known = vars(constants) | {"degrees": math.degrees, "__builtins__": {}}
    assert int(value) == round(eval(expression, known)), f"{name} of config.h is not {expression}"


def test_firmware_copies_the_numbers_that_both_sides_rely_on() -> None:
    copied = " ".join(expression for _, _, expression in COPIES)
    for name in (
        "FOOTPRINT_RADIUS_M",
        "WHEEL_TRACK_M",
        "ENCODER_TICKS_PER_TURN",
        "SPEED_LIMIT_M_S",
        "HEARTBEAT_TIMEOUT_S",
    ):
        assert re.search(rf"\b{name}\b", copied), name
