"""The simulated serial line: pace, bit errors, stalls, and the pseudo-terminal of a real process."""

from __future__ import annotations

import os
import select
from dataclasses import replace
from pathlib import Path

import pytest
import serial

from common.constants import SERIAL_BAUD
from offboard.simulator.electronics.pty_port import PtyPort
from offboard.simulator.electronics.serial_line import HostPort, SerialLine
from offboard.simulator.error_profiles import PROFILES, ErrorProfile, random_stream
from offboard.simulator.physics.world import STEP_S
from tests.unit.test_simulator_world import RecordingBoard


class TalkingBoard(RecordingBoard):
    def __init__(self) -> None:
        super().__init__()
        self.received = bytearray()
        self.to_send = b""

    def serial_write(self, data: bytes) -> None:
        self.received += data

    def serial_read(self) -> bytes:
        data, self.to_send = self.to_send, b""
        return data


def line_with(profile: ErrorProfile = PROFILES["none"]) -> tuple[SerialLine, TalkingBoard]:
    return SerialLine(profile, random_stream(1, "serial"), STEP_S), TalkingBoard()


def test_bytes_travel_in_both_directions_at_the_baud_rate() -> None:
    line, board = line_with()
    port = HostPort(line)
    message = bytes(range(256)) * 9
    port.write(message)
    board.to_send = message
    received = b""
    for step in range(1, 41):
        line.exchange(board, step * 0.005)
        received += port.read()
        assert len(received) <= step * SERIAL_BAUD / 10 * STEP_S
    assert received == message
    assert bytes(board.received) == message
    assert port.read() == b""


def test_bit_errors_come_as_often_as_declared() -> None:
    line, board = line_with(replace(PROFILES["none"], serial_bit_error_rate=1e-3))
    message = bytes(100_000)
    line.send(message)
    for step in range(1800):
        line.exchange(board, step * 0.005)
    assert len(board.received) == len(message)
    flipped = sum(byte.bit_count() for byte in board.received)
    assert flipped == pytest.approx(800, rel=0.15)


def test_a_stall_holds_bytes_back_and_loses_none() -> None:
    line, board = line_with(replace(PROFILES["none"], serial_stall_s=0.2, serial_stall_spacing_s=1.0))
    longest, waiting = 0, 0
    for step in range(1, 4000):
        line.send(b"x")
        line.exchange(board, step * 0.005)
        waiting = step - len(board.received)
        longest = max(longest, waiting)
    assert 38 <= longest <= 200
    for step in range(4000, 4100):
        line.exchange(board, step * 0.005)
    assert len(board.received) == 3999


def test_a_process_talks_to_the_board_through_the_pty(tmp_path: Path) -> None:
    line, board = line_with()
    link = tmp_path / "mega"
    port = PtyPort(line, link)
    try:
        # What the wire must not touch: control characters, newlines, bytes above 127
        message = bytes(range(256))
        with serial.Serial(str(link), 115200, timeout=0) as far_end:
            far_end.write(message)
            board.to_send = message
            select.select([port._master], [], [], 5.0)
            received = b""
            for step in range(1, 20):
                port.exchange(board, step * 0.005)
                received += far_end.read(4096)
        assert bytes(board.received) == message
        assert received == message
        # A bridge may go and another come; meanwhile bytes are lost, as on a wire
        board.to_send = bytes(20_000)
        for step in range(20, 500):
            port.exchange(board, step * 0.005)
        with serial.Serial(str(link), 115200, timeout=0) as far_end:
            far_end.write(b"again")
            select.select([port._master], [], [], 5.0)
            for step in range(500, 510):
                port.exchange(board, step * 0.005)
        assert bytes(board.received).endswith(b"again")
    finally:
        port.close()
    assert not os.path.lexists(link)
