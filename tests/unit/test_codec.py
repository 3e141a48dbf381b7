"""Messages survive the wire; whatever else comes is refused with a DecodeError."""

from __future__ import annotations

import contextlib
import dataclasses
import tracemalloc
from math import inf, nan
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from common.codec import CODEC_VERSION, DecodeError, as_text, decode, encode
from common.errors import ErrorCode
from common.field_checks import UnfitValue
from common.messages.health import ClockTick, LogLine, Status
from common.messages.mapping import GridUpdate, MapUpdate, PoseEstimate
from common.messages.mission import Operation, OperatorCommand, PlannerView
from common.messages.motion import CarrierReport, CarrierState, DriveCommand, Ranges, Speed
from common.messages.stop import Permit
from common.messages.topics import TOPICS
from tests.fuzz.wild import fit, message, packed

PAYLOADS = sorted({topic.payload for topic in TOPICS}, key=lambda payload: payload.__name__)
INTEGERS = st.integers(-(2**63), 2**64 - 1)
payloads = st.builds(fit, st.sampled_from(PAYLOADS), st.randoms(use_true_random=False))


def same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    return type(a) is type(b) and (a == b or (a != a and b != b))


@given(payloads, st.integers(1, 2**53 - 1), st.integers(0, 2**63 - 1))
def test_every_payload_comes_back_as_it_was_sent(payload: Any, sequence: int, boot_id: int) -> None:
    envelope = decode(encode(payload, sequence, boot_id), type(payload))
    assert (envelope.sequence, envelope.boot_id) == (sequence, boot_id)
    for field in dataclasses.fields(payload):
        assert same(getattr(payload, field.name), getattr(envelope.payload, field.name)), field.name


def refuse(data: bytes, kind: type) -> None:
    """Reading may succeed; if not, only with a DecodeError."""
    with contextlib.suppress(DecodeError):
        decode(data, kind)


@given(st.binary(max_size=200), st.sampled_from(PAYLOADS))
def test_random_bytes_raise_nothing_but_a_decode_error(data: bytes, kind: type) -> None:
    refuse(data, kind)


@given(payloads, st.data())
def test_damaged_messages_raise_nothing_but_a_decode_error(payload: Any, data: st.DataObject) -> None:
    damaged = bytearray(encode(payload, 1, 2))
    for _ in range(data.draw(st.integers(1, 4))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    refuse(bytes(damaged), type(payload))


JSON_LIKE = st.recursive(
    st.none() | st.booleans() | INTEGERS | st.floats() | st.text(max_size=8) | st.binary(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=12,
)
DTYPES = st.sampled_from(["<f4", "<f8", "|u1", "<i8", "O", "V0", "(2,3", "M8[s]", "", "f4,f4"]) | st.text(max_size=6)
ARRAYS = st.tuples(DTYPES, st.lists(INTEGERS, max_size=3), st.binary(max_size=16)).map(
    lambda parts: msgpack.ExtType(1, msgpack.packb(list(parts)))
)


@given(JSON_LIKE | st.lists(JSON_LIKE, min_size=4, max_size=4), st.sampled_from(PAYLOADS))
@example([CODEC_VERSION, float("inf"), 0, {"t_s": 0.0, "level": "", "text": ""}], LogLine)
def test_other_content_raises_nothing_but_a_decode_error(content: Any, kind: type) -> None:
    refuse(msgpack.packb(content), kind)


@given(ARRAYS)
@example(msgpack.ExtType(1, msgpack.packb(["(2,3", [1], b""])))
@example(msgpack.ExtType(1, msgpack.packb(["<f4", [2**63], b""])))
@example(msgpack.ExtType(7, b""))
def test_strange_arrays_raise_nothing_but_a_decode_error(array: msgpack.ExtType) -> None:
    body = {"t_s": 0.0, "revision": 0, "start": 0, "points_m": array, "inferred": array}
    refuse(msgpack.packb([CODEC_VERSION, 1, 0, body]), MapUpdate)


@pytest.mark.parametrize(
    "wrong",
    [
        {"points_m": np.zeros((3, 3), np.float32)},
        {"points_m": np.zeros(6, np.float32)},
        {"points_m": np.zeros((4, 2), np.float32)},
        {"points_m": np.array([["a", "b"]] * 3)},
        {"inferred": np.zeros((3, 1), np.uint8)},
        {"points_m": np.full((3, 2), np.nan, np.float32)},
        {"points_m": np.full((3, 2), 1e6, np.float32)},
        {"inferred": np.full(3, 2, np.uint8)},
    ],
)
def test_array_of_a_wrong_shape_or_kind_or_number_is_refused(wrong: dict[str, Any]) -> None:
    right = {"points_m": np.zeros((3, 2), np.float32), "inferred": np.zeros(3, np.uint8)}
    body = {"t_s": 0.0, "revision": 1, "start": 0}
    decode(message(body | {name: packed(array) for name, array in right.items()}), MapUpdate)
    with pytest.raises(DecodeError, match=r"points_m|inferred|array"):
        decode(message(body | {name: packed(array) for name, array in (right | wrong).items()}), MapUpdate)


def test_array_of_a_neighbouring_type_is_converted() -> None:
    points = packed(np.ones((3, 2)))
    body = {"t_s": 0.0, "revision": 1, "start": 0, "points_m": points, "inferred": packed(np.zeros(3, np.uint8))}
    assert decode(message(body), MapUpdate).payload.points_m.dtype == np.float32


@pytest.mark.parametrize("start", [-1, 2**40])
def test_map_that_goes_on_nowhere_is_refused(start: int) -> None:
    body = {"t_s": 0.0, "revision": 0, "start": 7} | {
        name: msgpack.ExtType(1, msgpack.packb([dtype, shape, b""]))
        for name, dtype, shape in (("points_m", "<f4", [0, 2]), ("inferred", "|u1", [0]))
    }
    decode(message(body), MapUpdate)
    with pytest.raises(DecodeError, match=str(start)):
        decode(message(body | {"start": start}), MapUpdate)


BODIES: dict[type, dict[str, Any]] = {
    DriveCommand: {"t_s": 1.0, "command_id": 1, "speed": 1, "yaw_rad": 0.5, "valid": True},
    PoseEstimate: {
        **{"t_s": 1.0, "x_m": 1.0, "y_m": 1.0, "heading_rad": 1.0, "yaw_rad": 1.0},
        **{"sd_xy_m": 0.1, "sd_heading_rad": 0.1, "map_revision": 1},
    },
    OperatorCommand: {"t_s": 1.0, "operation": "goto", "x_m": 1.0, "y_m": 1.0},
    Ranges: {"t_s": 1.0, "range_m": [1.0] * 5, "age_s": [0.1] * 5},
    LogLine: {"t_s": 1.0, "level": "INFO", "text": "all is well"},
    Permit: {"t_s": 1.0, "granted": True, "reason": "", "stop_sources": ["operator"], "challenge": b"c" * 16},
    ClockTick: {"t_s": 1.0, "speed": 1.0, "topics": ["a/b"], "boot_ids": [1], "sequences": [1]},
    GridUpdate: {
        **{"t_s": 1.0, "revision": 1, "origin_x_m": 0.0, "origin_y_m": 0.0},
        **{"cell_m": 0.1, "rows": 2, "columns": 2, "cells_zlib": b"x"},
    },
}


@pytest.mark.parametrize(
    ("kind", "poison"),
    [
        (OperatorCommand, {"x_m": nan}),
        (OperatorCommand, {"y_m": inf}),
        (OperatorCommand, {"x_m": 1e6}),
        (LogLine, {"t_s": nan}),
        (LogLine, {"text": b"bytes"}),
        (PoseEstimate, {"x_m": nan}),
        (PoseEstimate, {"heading_rad": -inf}),
        (PoseEstimate, {"sd_xy_m": -0.1}),
        (PoseEstimate, {"map_revision": 2**63}),
        (PoseEstimate, {"map_revision": -1}),
        (DriveCommand, {"command_id": 2**31}),
        (DriveCommand, {"speed": True}),
        (DriveCommand, {"speed": [1]}),
        (Ranges, {"range_m": [1.0] * 4}),
        (Ranges, {"range_m": [1.0] * 4 + ["1"]}),
        (Ranges, {"range_m": [1.0] * 4 + [inf]}),
        (Ranges, {"age_s": [0.1] * 4 + [nan]}),
        (Ranges, {"age_s": 0.1}),
        (Permit, {"stop_sources": [1]}),
        (Permit, {"stop_sources": [["operator"]]}),
        (Permit, {"stop_sources": ["x"] * 1000}),
        (Permit, {"challenge": b"c" * 17}),
        (ClockTick, {"boot_ids": []}),
        (ClockTick, {"sequences": [-1]}),
        (GridUpdate, {"rows": 0}),
        (GridUpdate, {"rows": 20_000, "columns": 20_000}),
        (GridUpdate, {"cell_m": 0.0}),
    ],
)
def test_poisoned_value_is_refused_and_the_reason_names_the_field(kind: type, poison: dict[str, Any]) -> None:
    decode(message(BODIES[kind]), kind)
    with pytest.raises(DecodeError, match="|".join(poison)):
        decode(message(BODIES[kind] | poison), kind)


@pytest.mark.parametrize("stamp", [(0, 1), (-1, 1), (2**53, 1), (1.5, 1), (True, 1), (1, -1), (1, 2**63), (1, nan)])
def test_message_without_a_proper_sequence_number_and_boot_id_is_refused(stamp: tuple[Any, Any]) -> None:
    with pytest.raises(DecodeError, match="sequence number"):
        decode(msgpack.packb([CODEC_VERSION, *stamp, BODIES[DriveCommand]]), DriveCommand)


def test_a_distance_may_be_nan_and_an_uncertainty_infinite() -> None:
    assert decode(message(BODIES[Ranges] | {"range_m": [nan] * 5}), Ranges).payload.range_m[4] != 0
    lost = decode(message(BODIES[PoseEstimate] | {"sd_xy_m": inf}), PoseEstimate)
    assert lost.payload.sd_xy_m == inf


def test_text_is_cleaned_and_cut_and_never_refused() -> None:
    text = "two\nlines, \x1b[31mred\x07\x9b, \u202eturned, [/a] stays" + "." * 10_000
    line = decode(message(BODIES[LogLine] | {"text": text}), LogLine).payload
    assert line.text.startswith("two lines, \ufffd[31mred\ufffd\ufffd, \ufffdturned, [/a] stays...")
    assert line.text.isprintable()
    assert len(line.text) == 2_000
    assert line.text.endswith("…")


def test_the_reason_of_a_refusal_is_fit_for_a_terminal_too() -> None:
    for poison in ({"speed": "\x1b[2J" * 1000}, {"command_id": "\x07\n"}):
        with pytest.raises(DecodeError) as refused:
            decode(message(BODIES[DriveCommand] | poison), DriveCommand)
        assert str(refused.value).isprintable()
        assert len(str(refused.value)) < 200


@pytest.mark.parametrize("bomb", [[[]] * 2_000_000, {str(i): [] for i in range(100_000)}, [[[0] * 1000] * 1000]])
def test_a_small_message_cannot_fill_the_memory(bomb: Any) -> None:
    arrays = {"points_m": packed(np.zeros((0, 2), np.float32)), "inferred": bomb}
    data = message({"t_s": 0.0, "revision": 1, "start": 0} | arrays)
    tracemalloc.start()
    try:
        with pytest.raises(DecodeError):
            decode(data, MapUpdate)
        assert tracemalloc.get_traced_memory()[1] < 20_000_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    "payload",
    [
        OperatorCommand(1.0, Operation.GOTO, nan, 0.0),
        Ranges(1.0, (1.0,), (0.1,)),
        MapUpdate(1.0, 1, 0, np.full((1, 2), nan, np.float32), np.zeros(1, np.uint8)),
    ],
)
def test_what_would_be_refused_is_not_encoded(payload: Any) -> None:
    with pytest.raises(UnfitValue):
        encode(payload, 1, 1)


def test_numbers_of_numpy_and_members_of_enums_travel_as_what_they_are() -> None:
    status = Status(np.float64(1.5), "RUN", ErrorCode.BLOCKED, np.int64(7), np.bool_(True), 1)  # type: ignore[arg-type]
    assert decode(encode(status, 1, 1), Status).payload == Status(1.5, "RUN", int(ErrorCode.BLOCKED), 7, True, 1)


def test_missing_field_takes_its_default() -> None:
    body = {"t_s": 1.0, "state": "idle", "error_code": 0, "memory_kb": 1, "ready": True, "heartbeat_count": 2}
    assert decode(message(body), Status).payload == Status(1.0, "idle", 0, 1, True, 2, detail="", valid=True)


def test_field_that_was_renamed_is_read_from_an_older_recording() -> None:
    body = {"t_s": 1.0, "state": "idle", "error_code": 0, "memory_kb": 1, "ready": True, "beats": 2}
    assert decode(message(body), Status).payload.heartbeat_count == 2


def test_missing_field_without_a_default_is_an_error() -> None:
    with pytest.raises(DecodeError, match="t_s"):
        decode(message({"command_id": 1, "speed": 1, "yaw_rad": 0.0}), DriveCommand)


def test_unknown_field_of_a_newer_version_is_skipped() -> None:
    body = {"t_s": 1.0, "command_id": 1, "speed": 1, "yaw_rad": 0.5, "wheel_colour": "red"}
    assert decode(message(body), DriveCommand).payload == DriveCommand(1.0, 1, Speed.MEDIUM, 0.5)


def test_other_codec_version_is_named() -> None:
    with pytest.raises(DecodeError, match="version 99"):
        decode(message({}, version=99), Status)


@pytest.mark.parametrize(
    ("field", "value"),
    [("t_s", "now"), ("command_id", True), ("command_id", 1.5), ("speed", 7), ("valid", 1), ("yaw_rad", None)],
)
def test_field_of_a_wrong_type_is_refused(field: str, value: Any) -> None:
    body = {"t_s": 1.0, "command_id": 1, "speed": 1, "yaw_rad": 0.5, "valid": True} | {field: value}
    with pytest.raises(DecodeError):
        decode(message(body), DriveCommand)


def test_text_form_names_sender_receiver_and_milliseconds() -> None:
    ranges = Ranges(12.3456, (1.0, float("nan"), 0.25), (0.0, 0.1, 0.2))
    assert as_text("sim", "mmu", ranges) == "SIM_MMU_12346_1.000 - 0.250,0.000 0.100 0.200"


def test_text_form_splits_at_the_first_three_underscores() -> None:
    report = CarrierReport(2.0, CarrierState.BACKING_OFF, 7, 6, 0, 0.1, -20, 20, True, False, 7.4)
    sender, receiver, time_ms, text = as_text("car", "planner", report).split("_", 3)
    assert (sender, receiver, time_ms) == ("CAR", "PLN", "2000")
    assert text.split(",")[:2] == ["BACKING_OFF", "7"]


@given(payloads)
def test_text_form_exists_for_every_payload(payload: Any) -> None:
    finite = dataclasses.replace(payload, t_s=1.0)
    assert as_text("mmu", "comm", finite).startswith("MMU_CM_1000_")


def test_text_form_shows_arrays_by_their_shape_only() -> None:
    view = PlannerView(0.0, "explore", "", np.zeros((3, 2), np.float32), 1, 2.0)
    assert "<3x2>" in as_text("planner", "visualizer", view)
