"""`check-sensors`, `drive` and `calibrate` at a board in the simulated building, through a real serial device."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import replace
from math import degrees, inf
from pathlib import Path

import pytest

from common.config import Config
from common.config_file import config_text, load_config
from common.errors import StartError
from common.geometry import Pose2, wrap_angle
from common.messages.motion import Speed
from deploy.boards.board_link import WrongFirmware
from deploy.boards.board_session import BoardSession
from deploy.service.body_calibration import calibrate_gyro, calibrated, measure_wheels
from deploy.service.hand_drive import HandDrive
from deploy.service.sensor_check import check_sensors
from offboard.evaluate.umbmark import end_point, fit_wheels
from offboard.simulator.electronics.board import HostBoard
from offboard.simulator.electronics.pty_port import PtyPort
from offboard.simulator.electronics.serial_line import SerialLine
from offboard.simulator.error_profiles import PROFILES, ErrorProfile, random_stream
from offboard.simulator.physics.world import STEP_S, World
from onboard.bridge.protocol import CarState, Odo
from onboard.bridge.serial_port import SerialPort
from onboard.bridge.translation import odometry
from onboard.mmu.back_end.map_builder import deferred_back_end
from onboard.mmu.mmu import carrier_of
from onboard.mmu.slam import Slam
from tests.firmware.course import open_hall

NO_SLIP = replace(PROFILES["realistic"], slip_sd_per_sqrt_m=0.0, bump_spacing_m=inf)


class Stand:
    """A robot in a wide hall behind a pseudo-terminal; waiting is what makes its time pass."""

    def __init__(self, profile: ErrorProfile = NO_SLIP, board: HostBoard | None = None, seed: int = 3) -> None:
        self._line = PtyPort(SerialLine(profile, random_stream(seed, "serial"), STEP_S))
        self.world = World(open_hall(9, 9), 0, seed, profile, board or HostBoard(), self._line)
        self._port = SerialPort(str(self._line.path), 115200)
        self.session = BoardSession(self._port, lambda: self.world.time_s, self.sleep)
        self.told: list[str] = []

    def sleep(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self.world.step()

    def close(self) -> None:
        self._port.close()
        self._line.close()


@pytest.fixture
def stand() -> Iterator[Stand]:
    stand = Stand()
    stand.session.connect()
    yield stand
    stand.close()


def nobody(_: str) -> str:
    raise AssertionError("nothing is to be asked here")


def test_check_of_a_sound_robot_finds_nothing(stand: Stand) -> None:
    arguments = argparse.Namespace(seconds=1.0, motors=True)
    assert check_sensors(stand.session, arguments, nobody, stand.told.append) == 0
    assert any("left 4" in line and "12.0 V" in line for line in stand.told)
    assert stand.told[-1] == "All of it answers as it should."
    assert abs(degrees(stand.world.truth.heading_rad)) < 3.0


def test_check_names_what_is_wrong(stand: Stand) -> None:
    stand.world.board.bumper(True)
    assert check_sensors(stand.session, argparse.Namespace(seconds=1.0, motors=True), nobody, stand.told.append) == 1
    assert "NOT OK  bumper is pressed, or its wire is open" in stand.told


def test_check_names_the_sonar_that_is_mute() -> None:
    class NoFrontSonar(HostBoard):
        def echo(self, sonar: int, width_us: int) -> None:
            if sonar != 2:
                super().echo(sonar, width_us)

    stand = Stand(board=NoFrontSonar())
    stand.session.connect()
    assert check_sensors(stand.session, argparse.Namespace(seconds=2.0, motors=False), nobody, stand.told.append) == 1
    assert stand.told[-1] == "NOT OK  sonar front does not answer: check its wires"
    stand.close()


def test_keys_drive_turn_and_stop(stand: Stand) -> None:
    hand = HandDrive(stand.session)
    assert hand.key("w")
    stand.session.run(3.0)
    assert stand.world.true_motion[0] == pytest.approx(0.16, abs=0.01)
    assert hand.key("a")
    stand.session.run(2.0)
    assert degrees(stand.world.truth.heading_rad) == pytest.approx(15.0, abs=1.5)
    assert hand.key(" ")
    stand.session.run(0.3)
    assert stand.session.link.car.state == CarState.STOPPED
    assert stand.world.board.outputs() == (0, 0, False)
    assert hand.key("w")
    stand.session.run(3.0)
    assert stand.world.true_motion[0] > 0.1
    assert not hand.key("q")


def test_nothing_moves_without_being_allowed(stand: Stand) -> None:
    stand.session.link.drive(Speed.MEDIUM, 0.0)
    stand.session.run(2.0)
    assert stand.world.board.outputs() == (0, 0, False)


def person_with_tape_measure(stand: Stand) -> Callable[[str], str]:
    begin: list[Pose2] = []

    def person(question: str) -> str:
        if "Enter" in question:
            begin.append(stand.world.truth)
            return ""
        moved = begin[-1].between(stand.world.truth)
        # A tape measure is good for half a centimetre
        return f"{round(200 * moved.x_m) / 2},{round(200 * moved.y_m) / 2}"

    return person


def test_squares_both_ways_find_wheels_and_track(stand: Stand, tmp_path: Path) -> None:
    fit = measure_wheels(stand.session, 2.0, 2, person_with_tape_measure(stand), stand.told.append)
    errors = stand.world.errors
    assert fit.diameter_m == pytest.approx(
        0.066 * (errors.left_diameter_factor + errors.right_diameter_factor) / 2, rel=0.004
    )
    assert fit.ratio == pytest.approx(errors.right_diameter_factor / errors.left_diameter_factor, abs=0.002)
    assert fit.track_m == pytest.approx(0.30 * errors.track_factor, rel=0.005)
    written = tmp_path / "robot.toml"
    written.write_text(config_text(calibrated(Config(), fit)), encoding="utf-8")
    assert load_config(written).wheels.track_m == pytest.approx(fit.track_m, abs=1e-5)


def test_a_robot_with_other_wheels_measures_right_once_they_arecalibrated(tmp_path: Path) -> None:
    stand = Stand(replace(NO_SLIP, diameter_mean_sd=0.05), seed=2)
    stand.session.connect()
    file = tmp_path / "robot.toml"
    fit = measure_wheels(stand.session, 2.0, 1, person_with_tape_measure(stand), stand.told.append)
    file.write_text(config_text(calibrated(Config(), fit)), encoding="utf-8")
    before, after = (Slam(deferred_back_end(), carrier_of(config)) for config in (Config(), load_config(file)))

    start = stand.world.truth
    for speed, seconds in ((Speed.MEDIUM, 10.0), (Speed.STOP, 2.0)):
        stand.session.link.drive(speed, stand.session.link.odo.yaw_cdeg / 100.0)
        end_s = stand.world.time_s + seconds
        while stand.world.time_s < end_s:
            for odo in [message for message in stand.session.step() if isinstance(message, Odo)]:
                for slam in (before, after):
                    slam.add_odometry(odometry(odo, stand.world.time_s, 0, imu_works=True))
    driven_m = start.distance_m(stand.world.truth)
    assert driven_m > 1.0
    assert after.pose.x_m == pytest.approx(driven_m, abs=0.01)
    assert abs(before.pose.x_m - driven_m) > 0.05
    stand.close()


def test_turns_on_the_spot_find_the_scale_of_the_gyro(stand: Stand) -> None:
    begun: list[float] = []
    turned_rad = 0.0

    def person(question: str) -> str:
        nonlocal turned_rad
        if "Enter" in question:
            begun.append(stand.world.truth.heading_rad)
            return ""
        missed_rad = stand.world.truth.heading_rad - begun[0]
        return f"{degrees(wrap_angle(missed_rad)):.1f}"

    assert calibrate_gyro(stand.session, argparse.Namespace(), person, stand.told.append) == 0
    scale = float(stand.told[-2].split()[3])
    assert scale == pytest.approx(stand.world.errors.gyro_scale_factor, abs=0.002)
    assert "kGyroLsbPer10Dps" in stand.told[-1]


def test_firmware_of_another_version_is_told_in_one_sentence(stand: Stand, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deploy.boards.board_link.protocol.HASH", 1)
    stand.world.reset_board()
    with pytest.raises(WrongFirmware, match=r"flash this version's firmware"):
        stand.session.run(1.0)


def test_a_silent_port_is_told_in_one_sentence() -> None:
    class Mute:
        def read(self) -> bytes:
            return b""

        def write(self, data: bytes) -> None:
            raise AssertionError("a board that has not said HELLO must hear nothing")

    now_s = 0.0

    def sleep(seconds: float) -> None:
        nonlocal now_s
        now_s += seconds

    with pytest.raises(StartError, match="HELLO"):
        BoardSession(Mute(), lambda: now_s, sleep).connect()


def test_fit_explains_what_wrong_wheels_would_tell() -> None:
    straight = [(0, 0), (14000, 14000)]
    left = [(0, 0)]
    right = [(0, 0)]
    for _ in range(4):
        for counts, (turn_l, turn_r) in ((left, (-1630, 1640)), (right, (1640, -1630))):
            at = counts[-1]
            counts += [(at[0] + 7000, at[1] + 7000), (at[0] + 7000 + turn_l, at[1] + 7000 + turn_r)]
    true = (1.440e-4, 1.436e-4, 0.302)
    runs = [(counts, tuple(end_point(counts, *true))) for counts in (straight, left, right)]
    fit = fit_wheels(runs)
    assert fit.ratio == pytest.approx(1.436 / 1.440, abs=1e-5)
    assert fit.track_m == pytest.approx(0.302, abs=1e-5)
    assert fit.rms_m < 1e-6
