"""What a person draws on the map: values, messages, geometry."""

from __future__ import annotations

import numpy as np
import pytest

from common.codec import decode, encode
from common.messages.mission import Zones
from common.zones import Zone, ZoneKind, gap_m, keeps_out, message_of, problem_with, zones_of

LINE = Zone(1, ZoneKind.LINE, ((2.0, -1.0), (2.0, 1.0)))
AREA = Zone(2, ZoneKind.AREA, ((3.0, 0.0), (5.0, 0.0), (5.0, 2.0), (3.0, 2.0)))
WEST = Zone(3, ZoneKind.ONLY, ((-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)))
EAST = Zone(4, ZoneKind.ONLY, ((1.0, -2.0), (6.0, -2.0), (6.0, 2.0), (1.0, 2.0)))


def out(*zones: Zone, at: tuple[float, float]) -> bool:
    return bool(keeps_out(zones, np.array([at]))[0])


def test_zones_come_through_a_message_as_they_were() -> None:
    data = encode(message_of(1.0, (LINE, AREA, WEST)), 1, 1)
    assert zones_of(decode(data, Zones).payload) == (LINE, AREA, WEST)


def test_what_a_newer_program_drew_or_what_is_cut_off_is_left_out() -> None:
    message = Zones(0.0, (1, 2), ("cliff", "no-go-area"), (2, 9), (0.0, 1.0), (0.0, 1.0))
    assert zones_of(message) == ()


def test_an_area_keeps_out_inside_and_areas_to_explore_alone_outside_of_all_of_them() -> None:
    assert out(AREA, at=(4.0, 1.0))
    assert not out(AREA, at=(2.0, 1.0))
    assert not out(WEST, EAST, at=(0.0, 0.0))
    assert not out(WEST, EAST, at=(5.0, 0.0))
    assert out(WEST, EAST, at=(8.0, 0.0))
    assert out(WEST, EAST, AREA, at=(4.0, 1.0))


def test_the_gap_counts_to_the_nearest_border_and_not_to_one_inside_another_area() -> None:
    assert gap_m((LINE,), 1.5, 0.0) == pytest.approx(0.5)
    assert gap_m((AREA,), 4.0, -0.4) == pytest.approx(0.4)
    assert gap_m((AREA,), 4.0, 0.3) == pytest.approx(-0.3)
    assert gap_m((WEST, EAST), 1.5, 0.0) == pytest.approx(2.0)
    assert gap_m((), 0.0, 0.0) == float("inf")


@pytest.mark.parametrize(
    ("kind", "corners_m"),
    [
        (ZoneKind.LINE, ((1.0, 1.0),)),
        (ZoneKind.LINE, ((1.0, 1.0), (1.0, 1.0))),
        (ZoneKind.AREA, ((0.0, 0.0), (1.0, 0.0))),
        (ZoneKind.ONLY, tuple((float(k), 0.0) for k in range(51))),
        (ZoneKind.LINE, ((0.0, 0.0), (501.0, 0.0))),
    ],
)
def test_what_is_no_line_or_area_is_refused_with_a_sentence(
    kind: ZoneKind, corners_m: tuple[tuple[float, float], ...]
) -> None:
    assert problem_with(kind, corners_m).endswith(".")
