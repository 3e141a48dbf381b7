"""The simulated body: what motors, walls, errors and events do to it, and what the board receives."""

from __future__ import annotations

import json
from dataclasses import replace
from math import degrees, pi, radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common.constants import TICK_M
from offboard.simulator.building.events import Events, EventsError, load_events
from offboard.simulator.building.floor import Floor, FloorError, load_floor, parse_floor
from offboard.simulator.electronics.board import ResetCause
from offboard.simulator.error_profiles import PROFILES, ErrorProfile, draw_run_errors, random_stream
from offboard.simulator.physics.drive_train import DriveTrain
from offboard.simulator.physics.world import World

FLOORS = Path(__file__).parents[2] / "offboard" / "simulator" / "floors"
NONE = PROFILES["none"]
PWM_016_M_S = 114


class RecordingBoard:
    """Drives as `drive` has it and records its inputs."""

    def __init__(self) -> None:
        self.drive = (0, 0, True)
        self.now_us = 0
        self.edges = [0, 0]
        self.gyro_z: list[int] = []
        self.echoes: list[tuple[int, int, int]] = []
        self.bumps: list[bool] = []
        self.button = False
        self.fire: dict[int, tuple[int, ...]] = {}

    def run(self, until_us: int) -> None:
        self.now_us = until_us

    def serial_write(self, data: bytes) -> None: ...

    def serial_read(self) -> bytes:
        return b""

    def encoder_edges(self, left: int, right: int) -> None:
        self.edges[0] += left
        self.edges[1] += right

    def echo(self, sonar: int, width_us: int) -> None:
        self.echoes.append((self.now_us, sonar, width_us))

    def imu(self, ax: int, ay: int, az: int, gx: int, gy: int, gz: int) -> None:
        self.gyro_z.append(gz)

    def bumper(self, pressed: bool) -> None:
        self.bumps.append(pressed)

    def cliff(self, left: bool, right: bool) -> None: ...

    def battery(self, mv: int) -> None: ...

    def stop_button(self, pressed: bool) -> None:
        self.button = pressed

    def fired(self) -> tuple[int, ...]:
        return self.fire.pop(self.now_us, ())

    def outputs(self) -> tuple[int, int, bool]:
        return self.drive

    def reset(self, cause: ResetCause = ResetCause.POWER_ON) -> None: ...


def hall(length_m: float = 20.0) -> Floor:
    content: dict[str, Any] = {
        "name": "hall",
        "units": "m",
        "wall_colour_rgb": [230, 230, 230],
        "corridor": {"exterior": [[0, 0], [length_m, 0], [length_m, 2], [0, 2]], "holes": []},
        "doors": [],
        "posters": [],
        "starts": [{"x_m": 1.0, "y_m": 1.0, "heading_deg": 0.0}],
    }
    return parse_floor(content, "floor file hall")


def world_with(
    floor: Floor | None = None, profile: ErrorProfile = NONE, seed: int = 1, events: Events | None = None
) -> tuple[World, RecordingBoard]:
    board = RecordingBoard()
    return World(floor or hall(), 0, seed, profile, board, events=events), board


def run(world: World, seconds: float) -> None:
    for _ in range(round(seconds / 0.005)):
        world.step()


@pytest.mark.parametrize("moment", range(20))
def test_a_body_whose_motors_are_cut_in_a_turn_stands_within_a_second_and_never_swings_back(moment: int) -> None:
    board = RecordingBoard()
    world = World(hall(), 0, moment, PROFILES["realistic"], board)
    board.drive = (-150, 150, True)
    for _ in range(200 + 7 * moment):
        world.step()
    assert world.true_motion[1] > 1.0
    board.drive = (0, 0, False)
    rates_rad_s = []
    for _ in range(400):
        world.step()
        rates_rad_s.append(world.true_motion[1])
    assert min(rates_rad_s) > -0.002
    assert max(rates_rad_s[200:]) < 0.002


def test_encoders_and_truth_agree_without_errors() -> None:
    world, board = world_with()
    board.drive = (PWM_016_M_S, PWM_016_M_S, True)
    run(world, 10.0)
    driven_m = world.truth.x_m - 1.0
    assert driven_m == pytest.approx(1.6, abs=0.05)
    assert board.edges[0] * TICK_M == pytest.approx(driven_m, abs=0.003)
    assert board.edges[0] == board.edges[1]
    assert world.truth.heading_rad == pytest.approx(0.0, abs=1e-6)


def test_gyro_counts_add_up_to_the_turn_without_errors() -> None:
    world, board = world_with()
    board.drive = (-80, 80, True)
    run(world, 4.0)
    board.drive = (0, 0, False)
    run(world, 1.0)
    turned_deg = sum(board.gyro_z) / 65.5 * 0.01
    assert degrees(world.truth.heading_rad) % 360 == pytest.approx(turned_deg % 360, abs=0.1)
    assert turned_deg > 90.0


def test_a_motor_in_its_dead_zone_does_not_turn() -> None:
    world, board = world_with()
    board.drive = (14, -14, True)
    run(world, 1.0)
    assert board.edges == [0, 0]


def test_the_body_stands_within_150_ms_after_the_driver_is_switched_off() -> None:
    world, board = world_with()
    board.drive = (200, 200, True)
    run(world, 1.0)
    assert world.true_motion[0] == pytest.approx(0.30, abs=0.01)
    board.drive = (200, 200, False)
    run(world, 0.16)
    assert abs(world.true_motion[0]) < 0.005


def test_a_wall_stops_the_body_while_the_wheels_slip_and_the_bumper_is_pressed() -> None:
    world, board = world_with(hall(length_m=3.0))
    board.drive = (PWM_016_M_S, PWM_016_M_S, True)
    run(world, 15.0)
    assert world.truth.x_m == pytest.approx(3.0 - 0.22, abs=0.01)
    assert -0.01 < world.clearance_m < 0.002
    assert board.edges[0] * TICK_M > 2.2
    assert board.bumps[-1]
    assert world.contacts == 1
    board.drive = (-PWM_016_M_S, -PWM_016_M_S, True)
    run(world, 2.0)
    assert not board.bumps[-1]


def test_every_sonar_that_was_fired_sends_its_pulse() -> None:
    world, board = world_with()
    board.fire = {100_000: (0, 4), 200_000: (2,)}
    run(world, 0.4)
    side = 0.93 // 0.0254 * 147
    assert [(sonar, width) for _, sonar, width in board.echoes] == [(0, side), (4, side), (2, 37500)]
    assert [at_us for at_us, *_ in board.echoes] == [100_000, 100_000, 200_000]


def test_a_restarted_board_begins_its_clock_anew_and_the_world_goes_on() -> None:
    world, board = world_with()
    run(world, 0.11)
    world.reset_board(ResetCause.WATCHDOG)
    run(world, 0.05)
    assert board.now_us == 50_000
    assert world.time_s == pytest.approx(0.16)


def test_the_stop_button_stays_in_over_a_restart_of_the_board_until_it_is_pushed_again() -> None:
    world, board = world_with()
    world.push_stop_button()
    assert board.button
    board.button = False
    world.reset_board()
    assert board.button
    world.push_stop_button()
    assert not board.button


def test_truth_is_logged_ten_times_a_second() -> None:
    world, _ = world_with()
    run(world, 2.0)
    times = np.array(world.truth_log)[:, 0]
    assert np.allclose(np.diff(times), 0.1)
    assert len(times) == 21


def test_a_run_repeats_to_the_bit_from_its_seed() -> None:
    logs = []
    for seed in (5, 5, 6):
        world, board = world_with(profile=PROFILES["realistic"], seed=seed)
        board.drive = (PWM_016_M_S, PWM_016_M_S, True)
        run(world, 3.0)
        logs.append((world.truth_log, tuple(board.gyro_z)))
    assert logs[0] == logs[1]
    assert logs[0] != logs[2]


def test_a_start_that_is_not_there_is_refused() -> None:
    with pytest.raises(FloorError, match="has no start 3"):
        World(hall(), 3, 1, NONE, RecordingBoard())


def test_slip_of_a_wheel_grows_with_the_root_of_the_distance() -> None:
    profile = replace(NONE, slip_sd_per_sqrt_m=0.03)
    slipped_m = []
    for seed in range(60):
        train = DriveTrain(draw_run_errors(profile, seed), random_stream(seed, "slip"), 0.005)
        driven_m = sum(train.step(200, 200, True)[0] for _ in range(2000)) * 0.005
        slipped_m.append(driven_m - sum(train.edges()) / 2 * TICK_M)
    # Two wheels over 3 m: their mean slips less by the root of two
    assert np.std(slipped_m) == pytest.approx(0.03 * np.sqrt(3.0 / 2.0), rel=0.3)


def test_errors_of_a_run_follow_their_profile() -> None:
    drawn = [draw_run_errors(PROFILES["harsh"], seed) for seed in range(400)]
    ratios = [d.left_diameter_factor / d.right_diameter_factor for d in drawn]
    assert np.std(ratios) == pytest.approx(0.006, rel=0.15)
    assert np.std([d.track_factor for d in drawn]) == pytest.approx(0.02, rel=0.15)
    biases = np.array([d.gyro_bias_rad_s for d in drawn])
    assert np.abs(biases).max() <= radians(20.0)
    assert np.abs(biases).max() > radians(19.0)
    exact = draw_run_errors(NONE, 3)
    assert (exact.left_diameter_factor, exact.right_diameter_factor, exact.track_factor) == (1.0, 1.0, 1.0)


def events_from(tmp_path: Path, content: Any, floor: Floor) -> Events:
    file = tmp_path / "events.json"
    file.write_text(json.dumps(content))
    return load_events(file, floor)


def test_a_person_walks_gives_an_echo_stops_the_body_and_leaves(tmp_path: Path) -> None:
    content = {"people": [{"from_s": 1, "to_s": 30, "speed_m_s": 1.0, "waypoints": [[5, 1], [3, 1]]}]}
    floor = hall()
    world, board = world_with(floor, events=events_from(tmp_path, content, floor))
    board.fire = {4_000_000: (2,)}
    run(world, 0.5)
    assert world.people == []
    run(world, 4.0)
    assert world.people == [(3.0, 1.0, 0.25)]
    assert board.echoes[-1][2] == int((2.0 - 0.25 - 0.07) / 0.0254) * 147
    board.drive = (PWM_016_M_S, PWM_016_M_S, True)
    run(world, 20.0)
    assert world.truth.x_m == pytest.approx(3.0 - 0.25 - 0.22, abs=0.02)
    run(world, 10.0)
    assert world.people == []
    assert world.truth.x_m > 2.8


def test_a_barrier_stands_for_its_time_only(tmp_path: Path) -> None:
    floor = hall()
    content = {"blocked": [{"from_s": 1.0, "to_s": 12.0, "line": [[2, 0], [2, 2]]}]}
    world, board = world_with(floor, events=events_from(tmp_path, content, floor))
    board.drive = (PWM_016_M_S, PWM_016_M_S, True)
    run(world, 11.0)
    assert world.truth.x_m == pytest.approx(2.0 - 0.05 - 0.22, abs=0.01)
    run(world, 9.0)
    assert world.truth.x_m > 2.5


def test_an_opened_door_lets_the_robot_into_the_room(tmp_path: Path) -> None:
    floor = load_floor(FLOORS / "straight.json")
    door = floor.doors[0]
    assert door.normal_rad == pytest.approx(-pi / 2)
    x0, x1, y0 = door.x_m - 1.5, door.x_m + 1.0, door.y_m + 0.15
    room = [[x0, y0], [x1, y0], [x1, y0 + 3.0], [x0, y0 + 3.0]]
    events = events_from(tmp_path, {"opened": [{"at_s": 1.0, "door": door.number, "room": room}]}, floor)
    world, _ = world_with(floor, events=events)
    looking = (door.x_m, door.y_m - 1.0, pi / 2)
    assert world.echo_model.wall_ahead_m(*looking) == pytest.approx(1.0)
    run(world, 1.5)
    assert world.echo_model.wall_ahead_m(*looking) == pytest.approx(1.0 + 0.15 + 3.0)
    assert world.echo_model.wall_ahead_m(door.x_m, door.y_m + 0.07, 0.0) == pytest.approx(door.width_m / 2)


def test_a_person_turns_the_standing_robot_and_only_the_gyro_measures_it(tmp_path: Path) -> None:
    floor = hall()
    events = events_from(tmp_path, {"turned": [{"from_s": 1.0, "to_s": 3.0, "angle_deg": -40}]}, floor)
    world, board = world_with(floor, events=events)
    board.drive = (0, 0, False)
    run(world, 0.9)
    assert not any(board.gyro_z)
    run(world, 3.0)
    assert degrees(world.truth.heading_rad) == pytest.approx(-40.0, abs=0.5)
    assert sum(board.gyro_z) / 65.5 * 0.01 == pytest.approx(-40.0, abs=0.5)
    assert board.edges == [0, 0]
    assert (world.truth.x_m, world.truth.y_m) == pytest.approx((1.0, 1.0), abs=1e-6)


@pytest.mark.parametrize(
    ("content", "key", "complaint"),
    [
        ({"people": [{"from_s": 1, "speed_m_s": 1, "waypoints": []}]}, "people[0].waypoints", "at least 1 point"),
        ({"people": [{"from_s": 1, "waypoints": [[1, 1]]}]}, "people[0].speed_m_s", "missing"),
        ({"blocked": [{"from_s": 5, "to_s": 2, "line": [[1, 0], [1, 2]]}]}, "blocked[0].to_s", "later"),
        ({"blocked": [{"from_s": 5, "line": [[1, 0]]}]}, "blocked[0].line", "at least 2 points"),
        ({"opened": [{"at_s": 5, "door": "999", "room": []}]}, "opened[0].door", "no door"),
        ({"opened": [{"at_s": 5, "door": "101", "room": [[0, 0], [1, 0], [1, 1]]}]}, "opened[0].room", "fit"),
        ({"people": 5}, "people", "list"),
        ({"turned": [{"from_s": 5, "angle_deg": 40}]}, "turned[0].to_s", "missing"),
    ],
)
def test_a_bad_events_file_is_refused_in_one_sentence(tmp_path: Path, content: Any, key: str, complaint: str) -> None:
    with pytest.raises(EventsError) as caught:
        events_from(tmp_path, content, load_floor(FLOORS / "straight.json"))
    message = str(caught.value)
    assert "events.json" in message
    assert f"'{key}'" in message
    assert complaint in message
