"""What a page may send: a stop needs nothing, any other order the token, and nothing else is understood."""

from __future__ import annotations

import json
from contextlib import suppress
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.messages.mission import Operation
from offboard.operate.door_sender import OfDoor
from offboard.operate.operations import Order
from offboard.visualizer.requests import BadRequest, Confirmation, Release, Replay, Stop, parse

TOKEN = "secret"


def test_a_release_names_the_stop_that_was_seen_and_needs_the_token() -> None:
    assert parse(json.dumps({"order": "release", "epoch": 7, "token": TOKEN}), TOKEN) == Release(7)
    for wrong in ({"token": ""}, {"epoch": None}, {"epoch": -1}, {"epoch": "7"}):
        with pytest.raises(BadRequest):
            parse(json.dumps({"order": "release", "epoch": 7, "token": TOKEN} | wrong), TOKEN)


def test_what_is_said_of_a_door_comes_with_its_place() -> None:
    said = {"order": "door", "poi_id": 7, "x_m": 1, "y_m": 2.5, "number": "2.01", "room_name": "Küche"}
    assert parse(json.dumps(said | {"token": TOKEN}), TOKEN) == OfDoor(7, 1.0, 2.5, "2.01", "Küche")
    for wrong in ({"poi_id": True}, {"poi_id": 9999}, {"number": 7}, {"room_name": "x" * 101}, {"x_m": None}):
        with pytest.raises(BadRequest):
            parse(json.dumps(said | {"token": TOKEN} | wrong), TOKEN)
    with pytest.raises(BadRequest, match="no right"):
        parse(json.dumps(said), TOKEN)


def test_lines_and_areas_come_with_their_corners_and_leave_by_their_number() -> None:
    text = json.dumps({"order": "no-go-line", "corners_m": [[1, 2], [3.5, -4]], "token": TOKEN})
    assert parse(text, TOKEN) == Order(Operation.NO_GO_LINE, corners_m=((1.0, 2.0), (3.5, -4.0)))
    text = json.dumps({"order": "remove-zone", "zone": 3, "token": TOKEN})
    assert parse(text, TOKEN) == Order(Operation.REMOVE_ZONE, zone=3)


@pytest.mark.parametrize("corners", [None, 7, [[1]], [[1, "2"]], [[1, 1e9]], [[0, 0]] * 51, [{"x": 1}]])
def test_corners_that_are_none_are_refused(corners: Any) -> None:
    with pytest.raises(BadRequest):
        parse(json.dumps({"order": "only-here", "corners_m": corners, "token": TOKEN}), TOKEN)


@pytest.mark.parametrize("token", [TOKEN, ""])
def test_a_stop_needs_nothing(token: str) -> None:
    assert parse('{"order": "stop"}', token) == Stop()


@pytest.mark.parametrize("name", ["start", "pause", "resume", "home"])
def test_an_order_with_the_token_is_taken(name: str) -> None:
    assert parse(json.dumps({"order": name, "token": TOKEN}), TOKEN) == Order(Operation(name))


def test_a_place_to_drive_to_is_taken_with_its_metres() -> None:
    text = json.dumps({"order": "goto", "x_m": -3.5, "y_m": 1, "token": TOKEN})
    assert parse(text, TOKEN) == Order(Operation.GOTO, -3.5, 1.0)


@pytest.mark.parametrize("given_token", [None, "", "other", 7, "secre\u0165"])
def test_an_order_without_the_token_is_none(given_token: object) -> None:
    with pytest.raises(BadRequest, match="no right"):
        parse(json.dumps({"order": "start", "token": given_token}), TOKEN)


def test_a_page_that_was_given_no_token_orders_nothing_but_a_stop() -> None:
    with pytest.raises(BadRequest, match="no right"):
        parse('{"order": "start", "token": ""}', "")


@pytest.mark.parametrize("x_m", ["null", "true", '"1"', "NaN", "1e9", "[]"])
def test_a_place_that_is_none_is_refused(x_m: str) -> None:
    with pytest.raises(BadRequest):
        parse(f'{{"order": "goto", "x_m": {x_m}, "y_m": 0, "token": "{TOKEN}"}}', TOKEN)


@pytest.mark.parametrize(
    "text",
    [
        *("", "[]", "7", "{}", "[" * 1000, '{"order": 7, "token": "secret"}', '{"order": "dance", "token": "secret"}'),
        *('{"received": 1e3, "at": 0}', '{"received": true, "at": 0}', '{"received": 0, "at": "x"}'),
        '{"received": 0, "at": NaN}',
    ],
)
def test_what_no_page_sends_is_refused(text: str) -> None:
    with pytest.raises(BadRequest):
        parse(text, TOKEN)


def test_a_moment_of_a_recorded_run_needs_no_right() -> None:
    assert parse('{"replay": {"at_s": 12.5, "speed": 2}}', "") == Replay(12.5, 2.0)
    assert parse('{"replay": {"at_s": null, "speed": 0}}', "") == Replay(None, 0.0)


@pytest.mark.parametrize("wanted", ["1", "null", "{}", '{"at_s": "x", "speed": 1}', '{"at_s": 1, "speed": NaN}'])
def test_a_moment_that_is_none_is_refused(wanted: str) -> None:
    with pytest.raises(BadRequest):
        parse(f'{{"replay": {wanted}}}', "")


def test_a_confirmation_is_bytes_and_a_time() -> None:
    assert parse('{"received": 12, "at": 0.5}', TOKEN) == Confirmation(12, 0.5)


@given(st.text())
def test_no_text_does_any_harm(text: str) -> None:
    with suppress(BadRequest):
        parse(text, TOKEN)
