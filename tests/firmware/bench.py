"""The firmware on a bench: an ideal body under it, a hand-operated serial line beside it."""

from __future__ import annotations

import math

from common.constants import TICK_M, WHEEL_TRACK_M
from offboard.simulator.electronics.board import HostBoard
from onboard.bridge.line_protocol import LineDecoder, encode
from onboard.bridge.protocol import HASH, CarSta, CarState, Drv, Hb, Message, Odo, Rel, Start

STEP_US = 5000
STEP_S = STEP_US / 1e6
LSB_PER_DEG_S = 65.5
NOTHING_US = 37500


class Bench:
    """Robot with motors that reach 0.30 m/s at PWM 200, dead below 15, with a lag of 60 ms."""

    def __init__(self, board: HostBoard | None = None) -> None:
        self.board = board or HostBoard()
        self.now_us = 0
        self.wheels_m_s = [0.0, 0.0]
        self.rolled_m = [0.0, 0.0]
        self.x_m = self.y_m = self.heading_rad = 0.0
        self.gyro_bias_deg_s = 0.7
        self.heartbeats = False
        self.echo_us = [NOTHING_US] * 5
        self.next_echo_us: dict[int, int] = {}  # of one ping, before that again
        self.received: list[Message] = []
        self.car: CarSta | None = None
        self.odo: Odo | None = None
        self._decoder = LineDecoder()
        self._ticks = [0, 0]
        self._beat = 0
        self.boot, self.epoch = 1, 1  # of the planner, and of the stops

    def step(self) -> None:
        board = self.board
        pwm_left, pwm_right, enabled = board.outputs()
        for wheel, pwm in enumerate((pwm_left, pwm_right)):
            free_m_s = math.copysign(max(abs(pwm) - 15, 0) * 0.30 / 185, pwm) if enabled else 0.0
            self.wheels_m_s[wheel] += (free_m_s - self.wheels_m_s[wheel]) * (1 - math.exp(-STEP_S / 0.06))
            self.rolled_m[wheel] += self.wheels_m_s[wheel] * STEP_S
        left, right = self.wheels_m_s
        rate_rad_s = (right - left) / WHEEL_TRACK_M
        self.heading_rad += rate_rad_s * STEP_S
        self.x_m += (left + right) / 2 * math.cos(self.heading_rad) * STEP_S
        self.y_m += (left + right) / 2 * math.sin(self.heading_rad) * STEP_S
        ticks = [math.floor(rolled / TICK_M) for rolled in self.rolled_m]
        board.encoder_edges(ticks[0] - self._ticks[0], ticks[1] - self._ticks[1])
        self._ticks = ticks
        board.imu(0, 0, 16384, 0, 0, self.gyro_counts(rate_rad_s))
        for sonar in board.fired():
            board.echo(sonar, self.next_echo_us.pop(sonar, self.echo_us[sonar]))
        if self.heartbeats and self.now_us % 100_000 == 0:
            self._beat += 1
            self.send(Hb(self._beat % 65536, self.epoch))
        self.now_us += STEP_US
        board.run(self.now_us)
        for _, message in self._decoder.feed(board.serial_read()):
            self.received.append(message)
            if isinstance(message, CarSta):
                self.car = message
            elif isinstance(message, Odo):
                self.odo = message

    def gyro_counts(self, rate_rad_s: float) -> int:
        return round((math.degrees(rate_rad_s) + self.gyro_bias_deg_s) * LSB_PER_DEG_S)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self.step()

    def run_until(self, holds, limit_s: float = 20.0) -> float:
        """Steps until the condition holds; the time it took. Fails when it never does."""
        for n in range(round(limit_s / STEP_S)):
            if holds():
                return n * STEP_S
            self.step()
        raise AssertionError(f"not within {limit_s} s; car={self.car}")

    def send(self, message: Message) -> None:
        self.board.serial_write(encode(message, self.now_us // 1000))

    def drive(self, command_id: int, speed: int, yaw_deg: float) -> None:
        self.send(Drv(self.boot, command_id, speed, round(yaw_deg * 100) % 36000))

    def arm(self) -> None:
        """From wherever it is to READY."""
        self.heartbeats = True
        self.run_until(lambda: self.odo is not None and self.odo.flags & 16)
        self.run(0.15)
        self.send(Rel(self.epoch))
        self.send(Start(HASH, self.epoch))
        self.run_until(lambda: self.car is not None and self.car.state == CarState.READY, 1.0)

    @property
    def speed_m_s(self) -> float:
        return sum(self.wheels_m_s) / 2

    @property
    def heading_deg(self) -> float:
        return math.degrees(self.heading_rad)

    @property
    def enabled(self) -> bool:
        return self.board.outputs()[2]

    @property
    def pwm(self) -> tuple[int, int]:
        return self.board.outputs()[:2]


def ready_bench() -> Bench:
    bench = Bench()
    bench.arm()
    return bench
