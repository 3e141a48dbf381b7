"""The bridge between a real firmware core and a local mesh, and on ports that come and go."""

from __future__ import annotations

import math

import pytest

from common.bus import LocalMesh
from common.constants import SONAR_RING_RADIUS_M
from common.fields import STOPS_MAX
from common.messages.motion import CarrierState, DriveCommand, Speed
from common.messages.stop import Permit, StopRequest
from common.messages.topics import CARRIER, DISTANCES, DRIVE, ODOMETRY, PERMIT, RANGES, STATUS, STOP
from onboard.bridge import translation
from onboard.bridge.board_clock import BoardClock
from onboard.bridge.bridge import Bridge
from onboard.bridge.line_protocol import LineDecoder, encode
from onboard.bridge.protocol import HASH, STOP_BYTE, VERSION, Drv, Hb, Hello, Odo, Rel, Start
from onboard.bridge.serial_port import SerialLost, SerialPort
from tests.firmware.bench import Bench


class FakePort:
    """A port whose far end is the test."""

    def __init__(self) -> None:
        self.incoming = b""
        self.sent = b""
        self.gone = False

    def read(self) -> bytes:
        if self.gone:
            raise SerialLost("gone: plug it in")
        data, self.incoming = self.incoming, b""
        return data

    def write(self, data: bytes) -> None:
        if self.gone:
            raise SerialLost("gone: plug it in")
        self.sent += data

    def fileno(self) -> int | None:
        return None


class Rig:
    """A bridge on a local mesh, with permits as long as `permit` says so."""

    def __init__(self) -> None:
        self.port: FakePort | None = FakePort()
        self.opened = 0
        self.mesh = LocalMesh()
        self.bus, self.others = self.mesh.endpoint("bridge"), self.mesh.endpoint("test")
        self.bridge = Bridge(self.open)
        self.permit = False
        self.sources: tuple[str, ...] = ()
        self.stop_ids: tuple[int, ...] = ()
        self.epoch = 1
        self.now_s = 100.0

    def open(self) -> FakePort:
        self.opened += 1
        if self.port is None:
            raise SerialLost("/dev/x is not there: plug in the Arduino, or set bridge.serial_port in robot.toml")
        return self.port

    def step(self) -> None:
        self.mesh.now_s = self.now_s
        if self.permit is not None and round(self.now_s * 100) % 10 == 0:
            granted = self.permit and not self.sources
            permit = Permit(
                self.now_s, granted, "", self.sources, stop_epoch=self.epoch, stop_ids=self.stop_ids, life=7
            )
            self.others.publish(PERMIT, permit)
        self.bridge.step(self.bus, self.now_s)
        self.now_s = round(self.now_s + 0.01, 6)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            self.step()

    def run_until(self, holds, limit_s: float = 10.0) -> float:
        for n in range(round(limit_s * 100)):
            if holds():
                return n / 100
            self.step()
        raise AssertionError(f"not within {limit_s} s: {self.others.latest(CARRIER)} {self.status}")

    def drive(self, command_id: int, speed: Speed, yaw_rad: float = 0.0, boot: int = 1) -> None:
        self.mesh.now_s = self.now_s
        self.others.publish(DRIVE, DriveCommand(self.now_s, command_id, speed, yaw_rad, boot=boot))

    def stop(self, stop_id: int = 5) -> None:
        self.mesh.now_s = self.now_s
        self.others.publish(STOP, StopRequest(self.now_s, "operator", True, stop_id=stop_id))

    def latch(self, source: str, stop_id: int) -> None:
        """What comm does with a stop."""
        self.sources, self.stop_ids, self.epoch = (source,), (stop_id,), self.epoch + 1

    def release(self) -> None:
        """What comm does after a release and a resume."""
        self.sources = self.stop_ids = ()

    @property
    def status(self):
        return self.others.latest(STATUS["bridge"])

    @property
    def carrier(self):
        return self.others.latest(CARRIER)


class BenchRig(Rig):
    """With the real firmware and an ideal body at the far end."""

    def __init__(self) -> None:
        super().__init__()
        self.bench = Bench()
        self.cut = False

    def step(self) -> None:
        super().step()
        assert isinstance(self.port, FakePort)
        heard = self.bench.board.serial_read
        arrived = b""

        def tap() -> bytes:
            nonlocal arrived
            data = heard()
            arrived += data
            return data

        self.bench.board.serial_read = tap  # type: ignore[method-assign]
        if not self.cut:
            self.bench.board.serial_write(self.port.sent)
        self.port.sent = b""
        self.bench.step()
        self.bench.step()
        self.bench.board.serial_read = heard  # type: ignore[method-assign]
        if not self.cut:
            self.port.incoming += arrived

    @property
    def speed_m_s(self) -> float:
        return self.bench.speed_m_s


def sent_kinds(port: FakePort) -> list[type]:
    return [type(r.message) for r in LineDecoder().feed(port.sent.replace(STOP_BYTE, b""))]


def driving_rig() -> BenchRig:
    rig = BenchRig()
    rig.permit = True
    rig.run_until(lambda: rig.carrier is not None and rig.carrier.state is CarrierState.READY)
    rig.drive(1, Speed.MEDIUM)
    rig.run(2.0)
    assert rig.speed_m_s > 0.15
    return rig


def test_bridge_is_silent_until_the_board_says_hello() -> None:
    rig = Rig()
    rig.permit = True
    rig.run(3.0)
    assert rig.port.sent == b""
    rig.port.incoming = encode(Hello(VERSION, HASH, 0, 1), 10)
    rig.run(0.1)
    assert Hb in sent_kinds(rig.port)


def test_bridge_never_starts_a_board_of_another_protocol() -> None:
    rig = Rig()
    rig.permit = True
    rig.run(0.1)
    rig.port.incoming = encode(Hello(VERSION, HASH ^ 1, 0, 1), 10)
    rig.run(1.0)
    assert rig.port.sent == b""
    assert rig.status.error_code == 302
    assert not rig.status.ready


def test_missing_port_is_tried_once_a_second_and_told() -> None:
    rig = Rig()
    rig.port = None
    rig.run(5.0)
    assert rig.opened in (5, 6)
    assert rig.status.error_code == 301
    assert "plug in the Arduino" in rig.status.detail
    rig.port = FakePort()
    rig.run_until(lambda: rig.status.state == "LISTENING", 1.2)


def test_lost_port_is_opened_again_and_the_board_greeted_anew() -> None:
    rig = Rig()
    rig.permit = True
    rig.run(0.1)
    rig.port.incoming = encode(Hello(VERSION, HASH, 0, 1), 10)
    rig.run(0.1)
    old, rig.port = rig.port, FakePort()
    old.gone = True
    rig.run_until(lambda: rig.opened == 2, 1.2)
    rig.run(1.0)
    assert rig.port.sent == b""
    rig.port.incoming = encode(Hello(VERSION, HASH, 0, 2), 10)
    rig.run(0.2)
    assert Hb in sent_kinds(rig.port)


def test_silence_of_the_board_silences_the_bridge_until_the_next_hello() -> None:
    rig = Rig()
    rig.permit = True
    rig.run(0.1)
    rig.port.incoming = encode(Hello(VERSION, HASH, 0, 1), 10)
    rig.run(0.35)
    rig.port.sent = b""
    rig.run(1.0)
    assert rig.port.sent == b""
    assert rig.status.state == "LISTENING"
    assert rig.opened == 1


def test_restart_of_the_board_without_its_hello_is_noticed() -> None:
    rig = Rig()
    rig.run(0.1)
    rig.port.incoming = encode(Hello(VERSION, HASH, 0, 1), 50_000) + encode(Odo(1, 0, 0, 0, 0, 0, 0, 0, 0, 0), 50_100)
    rig.run(0.1)
    count = len(rig.others.take(ODOMETRY))
    assert count == 1
    rig.port.incoming = encode(Odo(1, 0, 0, 0, 0, 0, 0, 0, 0, 0), 300)
    rig.run(0.1)
    assert rig.others.take(ODOMETRY) == []
    assert rig.status.state == "LISTENING"


def test_whole_chain_drives_turns_and_reports() -> None:
    rig = driving_rig()
    odometry = rig.others.latest(ODOMETRY)
    assert odometry.speed_m_s == pytest.approx(0.16, abs=0.01)
    assert odometry.valid
    assert odometry.x_m == pytest.approx(rig.bench.x_m, abs=0.03)
    assert 0.0 <= rig.now_s - odometry.t_s < 0.13
    rig.drive(2, Speed.STOP, math.pi / 2)
    rig.run_until(lambda: rig.carrier.completed_id == 2, 6.0)
    assert rig.bench.heading_deg == pytest.approx(90.0, abs=1.0)
    assert rig.others.latest(ODOMETRY).standing or rig.run(0.5) is None
    for module in ("sim", "car", "bridge"):
        assert rig.others.latest(STATUS[module]).ready, module
    assert rig.status.error_code == 0


def test_driving_and_standing_by_turns_is_no_log_line_and_a_stop_is_one(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    rig = driving_rig()

    def lines() -> list[str]:
        return [record.getMessage() for record in caplog.records if record.getMessage().startswith("car state=")]

    before = lines()
    for number in range(2, 8):
        rig.drive(number, Speed.STOP if number % 2 == 0 else Speed.MEDIUM)
        rig.run(1.5)
    assert {CarrierState.READY, CarrierState.MOVING} & {rig.carrier.state}
    assert lines() == before
    rig.stop()
    rig.run(1.0)
    assert lines()[-1].startswith("car state=STOPPED")


def test_reports_reach_the_mesh_ten_times_a_second() -> None:
    rig = driving_rig()
    topics = (ODOMETRY, RANGES, DISTANCES, STATUS["sim"], STATUS["bridge"])
    for topic in (*topics, CARRIER, STATUS["car"]):
        rig.others.take(topic)
    rig.run(3.0)
    for topic in (*topics, CARRIER, STATUS["car"]):
        assert len(rig.others.take(topic)) in (29, 30, 31), topic.key


def test_a_burst_of_reports_is_waited_for_and_a_line_that_comes_alone_is_not() -> None:
    rig = driving_rig()
    rig.others.take(ODOMETRY)
    rig.run_until(lambda: rig.others.take(ODOMETRY))
    taken_s = rig.now_s
    assert rig.bridge.settle_s(taken_s + 0.03) < 0.005
    assert 0.019 < rig.bridge.settle_s(taken_s + 0.08) < 0.03


@pytest.mark.requirement("CAR_MR_06", "CC_MR_03")
def test_status_of_the_carrier_keeps_its_rate_while_it_is_steered() -> None:
    rig = driving_rig()
    rig.others.take(STATUS["car"])
    for number in range(30):
        rig.drive(100 + number, Speed.MEDIUM, 0.002 * number)
        rig.run(0.1)
    reports = rig.others.take(STATUS["car"])
    assert 27 <= len(reports) <= 33
    assert all(report.state and report.memory_kb for report in reports)


def test_odometry_says_how_much_of_the_yaw_walls_told() -> None:
    odometry = translation.odometry(Odo(1, 0, 0, 12000, -34, 0, 0, 0, 0, 0), 1.0, 1, True)
    assert math.degrees(odometry.yaw_rad) == pytest.approx(120.0)
    assert math.degrees(odometry.yaw_by_walls_rad) == pytest.approx(-0.34)


def test_ranges_count_from_the_ring_and_nothing_heard_is_not_a_number() -> None:
    rig = BenchRig()
    rig.bench.echo_us[2] = 100 * 147
    rig.run(3.0)
    ranges = rig.others.latest(RANGES)
    assert ranges.range_m[2] == pytest.approx(2.54 + SONAR_RING_RADIUS_M, abs=0.001)
    assert all(math.isnan(ranges.range_m[i]) for i in (0, 1, 3, 4))
    distances = rig.others.latest(DISTANCES)
    assert distances.front_m == pytest.approx(2.61, abs=0.001)
    assert math.isnan(distances.left_m)


def test_robot_stops_at_once_when_the_permit_is_revoked_and_release_moves_nothing() -> None:
    rig = driving_rig()
    rig.permit = False
    rig.run_until(lambda: not rig.bench.enabled, 0.15)
    rig.run(1.0)
    assert rig.carrier.stop_latched
    rig.permit = True
    rig.run_until(lambda: rig.carrier.state is CarrierState.READY, 2.0)
    rig.drive(1, Speed.MEDIUM)
    rig.run(1.0)
    assert rig.bench.pwm == (0, 0)
    rig.drive(2, Speed.MEDIUM)
    rig.run(2.0)
    assert rig.speed_m_s > 0.15


def test_robot_stops_when_the_permit_gets_old() -> None:
    rig = driving_rig()
    rig.permit = None  # type: ignore[assignment]
    took_s = rig.run_until(lambda: not rig.bench.enabled, 0.5)
    assert took_s <= 0.25


@pytest.mark.requirement("CAR_MR_05")
def test_operators_stop_works_within_two_steps_and_holds_whatever_comm_says_of_the_time_before() -> None:
    rig = driving_rig()
    rig.stop()
    took_s = rig.run_until(lambda: not rig.bench.enabled, 0.5)
    assert took_s <= 0.02
    rig.drive(2, Speed.MEDIUM)
    rig.run(2.0)
    assert not rig.bench.enabled
    assert (rig.carrier.stop_ids, rig.carrier.stop_names) == ((5,), ("operator",))
    rig.latch("operator", 5)
    rig.run_until(lambda: rig.carrier.board_epoch == 2 and not rig.carrier.stop_ids, 0.5)
    assert rig.carrier.state is CarrierState.STOPPED
    rig.release()
    rig.run_until(lambda: rig.carrier.state is CarrierState.READY, 2.0)
    rig.run(1.0)
    assert rig.bench.pwm == (0, 0)
    rig.drive(3, Speed.MEDIUM)
    rig.run(2.0)
    assert rig.speed_m_s > 0.15


def test_stop_sources_of_the_permit_hold_the_robot_too() -> None:
    rig = driving_rig()
    rig.latch("operator", 5)
    rig.run_until(lambda: not rig.bench.enabled, 0.15)
    rig.run(2.0)
    assert rig.carrier.state is CarrierState.STOPPED
    assert rig.status.state == "STOPPED"


def test_a_permit_of_an_older_stop_moves_nothing() -> None:
    rig = driving_rig()
    rig.latch("operator", 5)
    rig.run(0.5)
    rig.release()
    rig.epoch = 1
    rig.run(2.0)
    assert not rig.bench.enabled
    assert rig.carrier.bridge_epoch == 2


def test_button_on_the_robot_is_told_to_comm_and_holds_until_that_released_it() -> None:
    rig = driving_rig()
    rig.bench.board.stop_button(True)
    rig.run(0.5)
    assert rig.carrier.button_pressed
    rig.bench.board.stop_button(False)
    rig.run(2.0)
    assert rig.carrier.state is CarrierState.STOPPED
    assert rig.status.detail == "button"
    assert rig.carrier.stop_names == ("button",)
    rig.latch("button", rig.carrier.stop_ids[0])
    rig.run_until(lambda: not rig.carrier.stop_ids, 0.5)
    rig.release()
    rig.run_until(lambda: rig.carrier.state is CarrierState.READY, 2.0)


@pytest.mark.parametrize("pressed_again", [True, False], ids=["pressed again", "never let out"])
def test_button_after_the_release_is_another_stop(pressed_again: bool) -> None:
    rig = driving_rig()
    rig.bench.board.stop_button(True)
    rig.run(0.5)
    rig.latch("button", rig.carrier.stop_ids[0])
    rig.run(0.5)
    if pressed_again:
        rig.bench.board.stop_button(False)
        rig.run(0.5)
        rig.bench.board.stop_button(True)
    rig.release()
    rig.run_until(lambda: rig.carrier.stop_names == ("button",), 0.5)
    rig.bench.board.stop_button(False)
    rig.drive(2, Speed.MEDIUM)
    rig.run(2.0)
    assert not rig.bench.enabled


def test_button_outlives_a_reset_of_the_board_until_comm_knows_it() -> None:
    rig = driving_rig()
    rig.bench.board.stop_button(True)
    rig.run(0.2)
    rig.bench.board.stop_button(False)
    rig.bench.board.reset()
    rig.bench.now_us = 0
    rig.run(6.0)
    rig.drive(2, Speed.MEDIUM)
    rig.run(1.0)
    assert not rig.bench.enabled
    assert set(rig.carrier.stop_names) == {"button"}


def test_button_that_nobody_heard_of_is_known_after_a_reset_of_the_board() -> None:
    rig = driving_rig()
    rig.cut = True
    rig.bench.board.stop_button(True)
    rig.run(0.2)
    rig.bench.board.stop_button(False)
    rig.bench.board.reset()
    rig.bench.now_us = 0
    rig.bridge = Bridge(rig.open)
    rig.cut = False
    rig.run(6.0)
    rig.drive(2, Speed.MEDIUM)
    rig.run(1.0)
    assert not rig.bench.enabled
    assert rig.carrier.stop_names == ("button",)


def test_a_restarted_planner_stops_a_robot_that_the_one_before_set_going() -> None:
    rig = driving_rig()
    for number in range(2, 27):
        rig.drive(number, Speed.MEDIUM)
        rig.run(0.1)
    rig.drive(26, Speed.STOP, boot=2)
    rig.run_until(lambda: rig.bench.pwm == (0, 0), 2.0)
    assert (rig.carrier.boot, rig.carrier.command_id) == (2, 26)


def test_however_many_stops_are_pressed_all_are_held_and_the_carrier_is_reported() -> None:
    rig = driving_rig()
    for stop_id in range(1, 200):
        rig.others.publish(STOP, StopRequest(rig.now_s, "x" * stop_id, True, stop_id=stop_id))
    rig.run(1.0)
    report = rig.others.latest(CARRIER)
    assert report is not None
    assert rig.others.age_s(CARRIER) < 0.2
    assert len(report.stop_ids) == STOPS_MAX
    assert rig.speed_m_s == pytest.approx(0.0, abs=0.01)


def test_stop_byte_from_noise_is_released_because_nobody_asked_for_it() -> None:
    rig = driving_rig()
    rig.bench.board.serial_write(STOP_BYTE)
    rig.run_until(lambda: rig.carrier.state is CarrierState.STOPPED, 0.2)
    rig.run_until(lambda: rig.carrier.state is CarrierState.READY, 2.0)
    assert rig.bench.pwm == (0, 0)


def test_cut_line_stops_the_robot_and_it_comes_back_by_itself() -> None:
    rig = driving_rig()
    rig.cut = True
    rig.run_until(lambda: not rig.bench.enabled, 0.6)
    rig.run(1.0)
    assert rig.status.error_code == 301
    rig.cut = False
    rig.run_until(lambda: rig.carrier.state is CarrierState.READY and rig.status.ready, 4.0)
    rig.drive(2, Speed.MEDIUM)
    rig.run(2.0)
    assert rig.speed_m_s > 0.15


def test_restarted_board_begins_a_new_session() -> None:
    rig = driving_rig()
    session = rig.others.latest(ODOMETRY).session
    rig.bench.board.reset()
    rig.bench.now_us = 0
    rig.run_until(lambda: rig.others.latest(ODOMETRY).session != session, 2.0)
    assert not rig.others.latest(ODOMETRY).valid
    rig.run_until(lambda: rig.carrier.state is CarrierState.READY, 6.0)
    assert rig.bench.pwm == (0, 0)


def test_drive_command_that_got_lost_is_sent_again() -> None:
    rig = driving_rig()
    rig.drive(2, Speed.STOP)
    rig.cut = True
    rig.step()
    rig.cut = False
    rig.run_until(lambda: rig.carrier.command_id == 2, 0.5)


def test_bridge_that_ends_stops_the_robot() -> None:
    rig = driving_rig()
    rig.bridge.close()
    assert rig.port.sent == STOP_BYTE


def test_lines_to_the_board_are_only_those_it_needs() -> None:
    rig = driving_rig()
    seen: list[type] = []
    for _ in range(100):
        rig.step()
        seen += [type(r.message) for r in LineDecoder().feed(rig.port.sent)]
    assert set(seen) <= {Hb, Drv, Rel, Start}


def test_missing_device_is_told_in_one_sentence() -> None:
    with pytest.raises(SerialLost, match=r"^/dev/not-there is not there: plug in the Arduino"):
        SerialPort("/dev/not-there", 115200)


def test_board_time_survives_its_wrap_and_late_arrivals() -> None:
    clock = BoardClock()
    start_ms = 2**32 - 500
    assert clock.to_s(start_ms, 10.0) == pytest.approx(10.0)
    assert clock.to_s((start_ms + 1000) % 2**32, 11.3) == pytest.approx(11.0)
    assert clock.to_s((start_ms + 2000) % 2**32, 12.0) == pytest.approx(12.0)
    assert not clock.jumped_back((start_ms + 1990) % 2**32)
    assert clock.jumped_back((start_ms + 1000) % 2**32)
