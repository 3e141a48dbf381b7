"""Messages survive the wire; whatever else comes is refused with a DecodeError."""

from __future__ import annotations

import contextlib
import dataclasses
from enum import Enum
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import msgpack
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from common import messages
from common.codec import CODEC_VERSION, DecodeError, as_text, decode, encode
from common.messages import TOPICS, CarrierReport, CarrierState, DriveCommand, PlannerView, Ranges, Speed, Status

PAYLOADS = sorted({topic.payload for topic in TOPICS}, key=lambda payload: payload.__name__)
INTEGERS = st.integers(-(2**63), 2**63 - 1)


def values_of(hint: Any, sizes: dict[Any, int]) -> st.SearchStrategy[Any]:
    """Any value that a field of this type may hold; `sizes` of the letters in the shapes of arrays."""
    if get_origin(hint) is tuple:
        return st.lists(values_of(get_args(hint)[0], sizes), max_size=6).map(tuple)
    if get_origin(hint) is Annotated:
        array, shape = get_args(hint)
        (dtype,) = get_args(get_args(array)[1])
        return hnp.arrays(dtype, tuple(sizes.get(size, size) for size in shape))
    if issubclass(hint, Enum):
        return st.sampled_from(hint)
    simple = {float: st.floats(), int: INTEGERS, bool: st.booleans(), str: st.text(), bytes: st.binary()}
    return simple[hint]


@st.composite
def payloads(draw: st.DrawFn) -> Any:
    kind = draw(st.sampled_from(PAYLOADS))
    hints = get_type_hints(kind, include_extras=True)
    sizes = {letter: draw(st.integers(0, 5)) for letter in "NK"}
    values = {field.name: draw(values_of(hints[field.name], sizes)) for field in dataclasses.fields(kind)}
    if "start" in values:
        values["start"] %= messages.MAP_POINTS_MAX + 1
    return kind(**values)


def same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    return type(a) is type(b) and (a == b or (a != a and b != b))


@given(payloads(), st.integers(0, 2**63), st.integers(0, 2**63))
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


@given(payloads(), st.data())
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
@example([CODEC_VERSION, float("inf"), 0, {"t_s": 0.0, "level": "", "text": ""}], messages.LogLine)
def test_other_content_raises_nothing_but_a_decode_error(content: Any, kind: type) -> None:
    refuse(msgpack.packb(content), kind)


@given(ARRAYS)
@example(msgpack.ExtType(1, msgpack.packb(["(2,3", [1], b""])))
@example(msgpack.ExtType(1, msgpack.packb(["<f4", [2**63], b""])))
@example(msgpack.ExtType(7, b""))
def test_strange_arrays_raise_nothing_but_a_decode_error(array: msgpack.ExtType) -> None:
    body = {"t_s": 0.0, "revision": 0, "start": 0, "points_m": array, "inferred": array}
    refuse(msgpack.packb([CODEC_VERSION, 0, 0, body]), messages.MapUpdate)


@pytest.mark.parametrize(
    "wrong",
    [
        {"points_m": np.zeros((3, 3), np.float32)},
        {"points_m": np.zeros(6, np.float32)},
        {"points_m": np.zeros((4, 2), np.float32)},
        {"points_m": np.array([["a", "b"]] * 3)},
        {"inferred": np.zeros((3, 1), np.uint8)},
    ],
)
def test_array_of_a_wrong_shape_or_kind_is_refused(wrong: dict[str, Any]) -> None:
    right = {"points_m": np.zeros((3, 2), np.float32), "inferred": np.zeros(3, np.uint8)}
    decode(encode(messages.MapUpdate(0.0, 1, 0, **right), 1, 1), messages.MapUpdate)
    with pytest.raises(DecodeError, match=r"points_m|inferred"):
        decode(encode(messages.MapUpdate(0.0, 1, 0, **right | wrong), 1, 1), messages.MapUpdate)


@pytest.mark.parametrize("start", [-1, 2**40])
def test_map_that_goes_on_nowhere_is_refused(start: int) -> None:
    body = {"t_s": 0.0, "revision": 0, "start": 7} | {
        name: msgpack.ExtType(1, msgpack.packb([dtype, shape, b""]))
        for name, dtype, shape in (("points_m", "<f4", [0, 2]), ("inferred", "|u1", [0]))
    }
    decode(message(body), messages.MapUpdate)
    with pytest.raises(DecodeError, match=str(start)):
        decode(message(body | {"start": start}), messages.MapUpdate)


def message(body: dict[str, Any], version: int = CODEC_VERSION) -> bytes:
    return bytes(msgpack.packb([version, 3, 4, body]))


def test_missing_field_takes_its_default() -> None:
    body = {"t_s": 1.0, "state": "idle", "error_code": 0, "memory_kb": 1, "ready": True, "beats": 2}
    assert decode(message(body), Status).payload == Status(1.0, "idle", 0, 1, True, 2, detail="", valid=True)


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


@given(payloads())
def test_text_form_exists_for_every_payload(payload: Any) -> None:
    finite = dataclasses.replace(payload, t_s=1.0)
    assert as_text("mmu", "comm", finite).startswith("MMU_CM_1000_")


def test_text_form_shows_arrays_by_their_shape_only() -> None:
    view = PlannerView(0.0, "explore", "", np.zeros((3, 2), np.float32), 1, 2.0, False)
    assert "<3x2>" in as_text("planner", "visualizer", view)
