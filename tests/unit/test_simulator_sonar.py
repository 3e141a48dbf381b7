"""The echo model: which walls, corners and people answer, from where, and with what pulse."""

from __future__ import annotations

import time
from math import inf, pi, radians

import numpy as np
import pytest

from common.constants import SONAR_RING_RADIUS_M
from common.geometry import FloatArray
from offboard.simulator.building.polygons import ring_segments
from offboard.simulator.error_profiles import PROFILES, random_stream
from offboard.simulator.sensors.sonar import NO_ECHO_US, EchoModel, SonarBank, pulse_width_us


def room(x0: float, y0: float, x1: float, y1: float) -> FloatArray:
    return ring_segments(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=float))


def block(x0: float, y0: float, x1: float, y1: float) -> FloatArray:
    return ring_segments(np.array([[x0, y0], [x0, y1], [x1, y1], [x1, y0]], dtype=float))


CORRIDOR = EchoModel(room(-20.0, -1.2, 20.0, 1.2))


def inches_m(range_m: float) -> float:
    return pulse_width_us(range_m) / 147 * 0.0254


@pytest.mark.parametrize("off_deg", [0, 10, 20, 25])
def test_a_smooth_wall_reads_its_perpendicular_distance_up_to_25_degrees(off_deg: float) -> None:
    for side in (-1.0, 1.0):
        measured_m = inches_m(CORRIDOR.first_echo_m(0.0, 0.0, pi / 2 + side * radians(off_deg)))
        assert measured_m == pytest.approx(1.194, abs=0.001)


def test_a_smooth_wall_seldom_answers_beyond_35_degrees() -> None:
    rng = random_stream(1, "sonar")

    def lost(off_deg: float) -> float:
        bearing_rad = pi / 2 + radians(off_deg)
        return float(np.mean([CORRIDOR.first_echo_m(0, 0, bearing_rad, rng.gauss(0, 2)) == inf for _ in range(500)]))

    assert lost(20.0) < 0.01
    assert 0.15 < lost(30.0) < 0.45
    assert lost(35.0) > 0.9
    assert lost(45.0) == 1.0


@pytest.mark.parametrize(("wall_m", "answers"), [(0.5, True), (3.0, True), (6.3, True), (6.6, False)])
def test_a_wide_wall_ahead_answers_to_6_4_metres(wall_m: float, answers: bool) -> None:
    model = EchoModel(room(-1.0, -8.0, wall_m, 8.0))
    assert (model.first_echo_m(0.0, 0.0, 0.0) < inf) == answers


def test_a_far_wall_off_the_axis_is_silent_where_a_near_one_answers() -> None:
    for wall_m, answers in ((1.0, True), (5.0, False)):
        model = EchoModel(room(-9.0, -9.0, wall_m, 9.0))
        assert (model.first_echo_m(0.0, 0.0, radians(20.0)) < inf) == answers


def test_a_wall_whose_foot_lies_beside_it_does_not_answer() -> None:
    model = EchoModel(np.vstack([room(-30.0, -30.0, 30.0, 30.0), block(2.0, 1.9, 2.4, 8.0)]))
    assert model.first_echo_m(0.0, 0.0, 0.0) == inf
    assert model.first_echo_m(0.0, 2.5, 0.0) == pytest.approx(2.0)


def test_a_jamb_answers_from_any_angle_but_only_from_near() -> None:
    model = EchoModel(np.vstack([room(-30.0, -30.0, 30.0, 30.0), block(0.5, 0.1, 5.0, 5.0)]))
    near_m = model.first_echo_m(0.0, 0.0, 0.0)
    assert near_m == pytest.approx(np.hypot(0.5, 0.1))
    assert model.first_echo_m(-1.0, 0.0, 0.0) == inf


def test_a_nearer_wall_hides_what_is_behind_it() -> None:
    walls = np.vstack([room(-30.0, -30.0, 4.0, 30.0), block(1.0, -3.0, 1.1, 3.0)])
    assert EchoModel(walls).first_echo_m(0.0, 0.0, 0.0) == pytest.approx(1.0)
    # The screen is turned away so far that it sends nothing back, and still nothing behind it gives an echo
    turned = np.array([[0.6, -2.0], [3.0, 2.0], [3.1, 1.9], [0.7, -2.1]])
    model = EchoModel(np.vstack([room(-30.0, -30.0, 4.0, 30.0), ring_segments(turned[::-1])]))
    assert model.first_echo_m(0.0, 0.0, radians(10.0)) != pytest.approx(4.0)


def test_a_person_in_front_of_a_wall_gives_the_first_echo() -> None:
    assert CORRIDOR.first_echo_m(0.0, 0.0, 0.0, people=[(1.5, 0.0, 0.25)]) == pytest.approx(1.25)
    assert CORRIDOR.first_echo_m(0.0, 0.0, 0.0, people=[(-1.5, 0.0, 0.25)]) == inf
    assert CORRIDOR.first_echo_m(0.0, 0.0, pi / 2, people=[(0.0, 0.8, 0.25)]) == pytest.approx(0.55)


@pytest.mark.parametrize(
    ("range_m", "width_us"),
    [(0.01, 6 * 147), (0.1524, 6 * 147), (0.179, 7 * 147), (1.2, 47 * 147), (6.452, 254 * 147), (6.5, 37500)],
)
def test_pulses_are_whole_inches_from_6_to_254(range_m: float, width_us: int) -> None:
    assert pulse_width_us(range_m) == width_us
    assert pulse_width_us(inf) == NO_ECHO_US


def test_the_bank_without_errors_repeats_and_measures_from_the_ring() -> None:
    bank = SonarBank(PROFILES["none"], random_stream(1, "sonar"))
    pulses = bank.ping(CORRIDOR, (0.0, 0.0, 0.0), (0, 4))
    expected = pulse_width_us(1.2 - SONAR_RING_RADIUS_M)
    assert pulses == [(0, expected), (4, expected)]


def test_harsh_errors_lose_shorten_and_mix_up_echoes_as_often_as_they_should() -> None:
    bank = SonarBank(PROFILES["harsh"], random_stream(3, "sonar"))
    model = EchoModel(room(-20.0, -2.0, 20.0, 1.0))
    widths = np.array([dict(bank.ping(model, (0.0, 0.0, 0.0), (0, 4)))[4] for _ in range(4000)])
    right_us, left_us = pulse_width_us(2.0 - SONAR_RING_RADIUS_M), pulse_width_us(1.0 - SONAR_RING_RADIUS_M)
    assert np.mean(widths == NO_ECHO_US) == pytest.approx(0.10, abs=0.02)
    assert np.mean(np.abs(widths - left_us) <= 2 * 147) == pytest.approx(0.18, abs=0.03)
    assert np.mean(np.abs(widths - right_us) <= 4 * 147) == pytest.approx(0.70, abs=0.04)


def test_a_ping_costs_less_than_a_quarter_of_a_millisecond() -> None:
    rng = np.random.default_rng(1)
    blocks = [block(x, y, x + 0.8, y + 0.8) for x, y in rng.uniform(-9.0, 9.0, (60, 2))]
    model = EchoModel(np.vstack([room(-10.0, -10.0, 10.0, 10.0), *blocks]))
    bearings = np.linspace(-3.0, 3.0, 400).tolist()
    model.first_echo_m(0.2, 0.1, 0.0)
    begin = time.process_time()
    for bearing_rad in bearings:
        model.first_echo_m(0.2, 0.1, bearing_rad)
    assert (time.process_time() - begin) / len(bearings) < 250e-6
