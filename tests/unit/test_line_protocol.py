"""The lines of the serial line, at the bridge's end and against the firmware's."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from offboard.simulator.electronics.board import HostBoard
from onboard.bridge.line_protocol import LineDecoder, Received, crc16, decode, encode
from onboard.bridge.protocol import LAYOUT, MAX_LINE, Ack, CarSta, Drv, Hb, Message, Odo, Rel, Rng


@st.composite
def messages(draw: st.DrawFn) -> Message:
    kind = draw(st.sampled_from(list(LAYOUT)))
    values = []
    for field in LAYOUT[kind][3]:
        number = st.integers(field.minimum, field.maximum)
        values.append(draw(number) if field.length == 1 else tuple(draw(number) for _ in range(field.length)))
    return kind(*values)


def test_checksum_is_ccitt_false() -> None:
    assert crc16(b"123456789") == 0x29B1


@given(messages(), st.integers(0, 2**32 - 1))
def test_every_message_comes_back_as_it_was(message: Message, time_ms: int) -> None:
    line = encode(message, time_ms)
    assert len(line) <= MAX_LINE
    assert LineDecoder().feed(line) == [Received(time_ms, message)]


def test_a_line_reads_as_the_specification_demands() -> None:
    assert encode(Drv(1, 12, 1, 9000), 345).startswith(b"PLN_CAR_345_DRV,1,12,1,9000*")


@settings(max_examples=30)
@given(messages(), st.integers(0, 2**32 - 1))
def test_every_single_bit_error_is_rejected(message: Message, time_ms: int) -> None:
    line = encode(message, time_ms)
    for bit in range(8 * len(line)):
        damaged = bytearray(line)
        damaged[bit // 8] ^= 1 << bit % 8
        assert LineDecoder().feed(bytes(damaged) + b"\n") == [], bytes(damaged)


@given(st.binary(max_size=300))
def test_garbage_never_raises_and_costs_at_most_one_line(garbage: bytes) -> None:
    decoder = LineDecoder()
    decoder.feed(garbage)
    line = encode(Hb(1, 1), 2)
    received = decoder.feed(line + line)
    assert received[-1] == Received(2, Hb(1, 1))
    assert len(received) in (1, 2)


@given(st.lists(messages(), max_size=5), st.integers(1, 17))
def test_lines_may_arrive_in_any_pieces(sent: list[Message], size: int) -> None:
    data = b"".join(encode(message, 1) for message in sent)
    decoder = LineDecoder()
    received = [r for at in range(0, len(data), size) for r in decoder.feed(data[at : at + size])]
    assert [r.message for r in received] == sent
    assert decoder.bad_lines == 0


@pytest.mark.parametrize(
    "text",
    [
        b"PLN_CAR_1_DRV,1,0,1,0",
        b"PLN_CAR_1_DRV,1,1,3,0",
        b"PLN_CAR_1_DRV,1,1,1",
        b"PLN_CAR_1_DRV,1,1,1,0,0",
        b"A_B_1_X",
    ],
)
def test_out_of_range_and_unknown_lines_are_rejected(text: bytes) -> None:
    assert decode(b"%s*%04X" % (text, crc16(text))) is None


def test_bad_lines_are_counted() -> None:
    decoder = LineDecoder()
    decoder.feed(b"hello\n\n" + encode(Rel(1), 1) + b"x" * 500 + b"\n")
    assert decoder.bad_lines == 2


def test_bridge_understands_everything_the_firmware_says_and_the_firmware_the_bridge() -> None:
    board, decoder = HostBoard(), LineDecoder()
    board.imu(0, 0, 16384, 0, 0, -40)
    board.serial_write(encode(Drv(1, 2147483647, -1, 35999), 2**32 - 1))
    received = []
    for until_us in range(5000, 1_000_000, 5000):
        board.run(until_us)
        received += decoder.feed(board.serial_read())
    assert decoder.bad_lines == 0
    assert {type(r.message) for r in received} >= {Odo, Rng, CarSta, Ack}
    assert next(r.message for r in received if isinstance(r.message, Ack)) == Ack(3, 2147483647, 1)
