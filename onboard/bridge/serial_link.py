"""The serial line and the board behind it: opens the port, waits for HELLO, notices what is lost. Port -> messages."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from enum import Enum

from common.pace import Pace
from onboard.bridge import protocol
from onboard.bridge.board_clock import BoardClock
from onboard.bridge.line_protocol import LineDecoder, Received, encode
from onboard.bridge.protocol import STOP_BYTE, Hello, Message
from onboard.bridge.serial_port import Port, SerialLost

LINE_LOST_S = 0.3  # no valid line for this long: the board is lost
REOPEN_S = 1.0
RESET_AFTER_S = 10.0  # a port that stays silent for this long is opened anew
NOISE_WINDOW_S = 10.0

_log = logging.getLogger("bridge")


class LinkState(Enum):
    CLOSED = "CLOSED"  # no port
    LISTENING = "LISTENING"  # open, no HELLO yet
    MISMATCH = "MISMATCH"  # HELLO of another protocol
    CONNECTED = "CONNECTED"


class SerialLink:
    """`open_port` opens the port, or raises SerialLost with a sentence for people. `forget` is called for a lost board.

    Every method raises SerialLost when the port is gone; `close` it then.
    """

    def __init__(self, open_port: Callable[[], Port], forget: Callable[[], None]) -> None:
        self.state = LinkState.CLOSED
        self.why_closed = ""
        self.session = -1  # of the board, new with each of its restarts
        self._open_port, self._forget = open_port, forget
        self._port: Port | None = None
        self._opening = Pace(REOPEN_S)
        self._decoder = LineDecoder()
        self._received_s = float("-inf")
        self._clock = BoardClock()
        self._started_s: float | None = None
        self._noise: deque[tuple[float, int]] = deque([(float("-inf"), 0)])

    @property
    def connected(self) -> bool:
        return self.state is LinkState.CONNECTED

    @property
    def due_s(self) -> float:
        """When `read` must be called though no byte comes (s)."""
        if self._port is None:
            return self._opening.due_s
        return self._received_s + (LINE_LOST_S if self.connected else RESET_AFTER_S)

    def fileno(self) -> int | None:
        """What to wait on for bytes; None while there is no port."""
        return self._port.fileno() if self._port is not None else None

    @property
    def bad_lines(self) -> int:
        return self._decoder.bad_lines

    def bad_lines_lately(self, now_s: float) -> int:
        """Within NOISE_WINDOW_S; to be called in every step."""
        if self._noise[-1][1] != self.bad_lines:
            self._noise.append((now_s, self.bad_lines))
        while len(self._noise) > 1 and self._noise[1][0] < now_s - NOISE_WINDOW_S:
            self._noise.popleft()
        return self._noise[-1][1] - self._noise[0][1]

    def read(self, now_s: float) -> Iterator[tuple[Message, float]]:
        """What came from a connected board, and when the board sent it by this clock (s)."""
        if self._started_s is None:
            self._started_s = now_s
        if self._port is None and not self._reopen(now_s):
            return
        assert self._port is not None
        for received in self._decoder.feed(self._port.read()):
            yield from self._take_line(received, now_s)
        silent_s = now_s - self._received_s
        if self.connected and silent_s >= LINE_LOST_S:
            self._lose_board(f"no line for {LINE_LOST_S:.1f} s")
        elif silent_s >= RESET_AFTER_S:
            self.close(f"no line for {RESET_AFTER_S:.0f} s")

    def send(self, messages: Sequence[Message], now_s: float) -> None:
        """All of them in one write, which costs a wake-up of the driver."""
        if messages:
            assert self._started_s is not None
            time_ms = int((now_s - self._started_s) * 1000.0)
            self.write(b"".join(encode(message, time_ms) for message in messages))

    def write(self, data: bytes) -> None:
        assert self._port is not None
        self._port.write(data)

    def close_standing(self, why: str) -> None:
        """Sends the stop byte, then closes."""
        if self._port is not None and self.connected:
            try:
                self._port.write(STOP_BYTE)
            except SerialLost as error:
                _log.warning("stop byte not sent reason=%s", error)
        self.close(why)

    def close(self, why: str) -> None:
        close = getattr(self._port, "close", None)
        if close is not None:
            close()
        if why != self.why_closed:
            _log.warning("link=CLOSED reason=%s", why)
        self._port, self.state, self.why_closed = None, LinkState.CLOSED, why
        self._forget_board()

    def _reopen(self, now_s: float) -> bool:
        if not self._opening.due(now_s):
            return False
        self._port = self._open_port()
        self._decoder = LineDecoder()
        self._noise = deque([(now_s, 0)])
        self.state = LinkState.LISTENING
        self._received_s = now_s
        self.why_closed = ""
        _log.info("link=%s", self.state.value)
        return True

    def _take_line(self, received: Received, now_s: float) -> Iterator[tuple[Message, float]]:
        self._received_s = now_s
        if isinstance(received.message, Hello):
            self._greet(received.message)
        if not self.connected:
            return
        if self._clock.jumped_back(received.time_ms):
            # Its HELLO was lost; counts and yaw began anew
            self._lose_board("the board has restarted")
            return
        yield received.message, self._clock.to_s(received.time_ms, now_s)

    def _greet(self, hello: Hello) -> None:
        if (hello.version, hello.hash) != (protocol.VERSION, protocol.HASH):
            if self.state is not LinkState.MISMATCH:
                _log.error("protocol mismatch board=%d/%04X own=%d/%04X", *hello[:2], protocol.VERSION, protocol.HASH)
            self.state = LinkState.MISMATCH
            self._forget_board()
            return
        if self.connected and hello.session == self.session:
            return
        self._forget_board()
        self.state = LinkState.CONNECTED
        self.session = hello.session
        self._clock = BoardClock()
        _log.info("link=%s session=%d reset_cause=%d", self.state.value, hello.session, hello.reset_cause)

    def _lose_board(self, why: str) -> None:
        self.state = LinkState.LISTENING
        _log.warning("link=%s reason=%s", self.state.value, why)
        self._forget_board()

    def _forget_board(self) -> None:
        self.session = -1
        self._forget()
