"""Sequences of events around the software stop, on the robot's own processes and its real firmware.

After a latched stop nothing moves before a release of that very stop and a resume of it, whatever is killed, frozen,
late, repeated or forgotten meanwhile. One robot serves all tests, one after the other.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from common.clock import FREE_LEASE_S
from common.config import CommSection
from common.config_file import config_text
from common.messages.health import Status
from common.messages.mission import Operation
from common.messages.motion import Speed
from common.messages.stop import StopRequest
from common.messages.topics import DRIVE, STATUS, STOP
from deploy.bench.relay import Relay
from offboard.command_center.widgets.stop_bar import bar_text
from offboard.operate.operations import Answer
from offboard.operate.software_stop import SOURCE, Demand, Look
from onboard.comm.stop_owner import LOST_RECORD, RESTART
from onboard.comm.stop_record import RECORD_NAME, read_record, write_record
from tests.system.center import Center
from tests.system.conftest import Mesh, until
from tests.system.marching_planner import COMMANDS
from tests.system.motors import STANDS_FOR_S, STOPPED_WITHIN_S
from tests.system.robot import Robot

pytestmark = pytest.mark.timeout(120)
MARCHING_PLANNER = Path(__file__).with_name("marching_planner.py")
DISAGREEMENT_MAX_S = 1.0


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    with closing(Robot(tmp_path_factory.mktemp("robot"))) as made:
        yield made


@pytest.mark.requirement("CAR_MR_02")
def test_a_restarted_planner_stops_the_robot_by_a_command_whose_number_was_given_up_in_its_life_before(
    robot: Robot,
) -> None:
    def marched(speed: Speed) -> Callable[[], bool]:
        return lambda: (
            (command := robot.bus.latest(DRIVE)) is not None
            and (command.command_id, command.speed) == (COMMANDS, speed)
        )

    robot.start("planner", str(MARCHING_PLANNER), Speed.MEDIUM.name, "1")
    until(marched(Speed.MEDIUM), 40.0, "the last command of the first life")
    robot.motors.await_driving()
    killed_s = robot.kill("planner")
    robot.motors.dead_after_s(killed_s)
    robot.start("planner", str(MARCHING_PLANNER), Speed.STOP.name, "2")
    robot.motors.await_driving(killed_s)
    until(marched(Speed.STOP), 20.0, "the last command of the second life")
    until(lambda: not robot.motors.read()[-1].turning, 2.0, "the end of all motion")
    assert robot.motors.stands()
    robot.kill("planner")


@pytest.mark.requirement("CC_MR_04")
def test_a_release_moves_nothing_although_the_planner_was_frozen_since_before_the_stop(robot: Robot) -> None:
    robot.drive()
    robot.signal("planner", signal.SIGSTOP)
    robot.press()
    robot.release()
    thawed_s = robot.signal("planner", signal.SIGCONT)
    assert robot.motors.stands(3.0)
    robot.await_sound(thawed_s)
    assert robot.answer_to(Operation.START) is Answer.REFUSED, "the mission is under way"
    for operation in (Operation.GOTO, Operation.HOME):
        robot.operate(operation)
    assert robot.motors.stands()
    robot.drive()


@pytest.mark.requirement("CAR_MR_05", "CC_MR_04")
def test_the_stop_of_the_robots_own_button_outlives_bridge_and_board_and_is_released_as_any_other(
    robot: Robot,
) -> None:
    robot.drive()
    pushed_s = robot.push_button()
    assert robot.motors.dead_after_s(pushed_s) < STOPPED_WITHIN_S
    until(lambda: robot.permit.stop_sources == ("button",), what="the button in the permit")
    until(lambda: robot.center.node.snapshot().look is Look.LATCHED, what="the button in the command center")
    # First the bar sends to the red button: until it is reported that the wheels stand
    remedy = "held by button; let the button out"
    until(lambda: remedy in bar_text(robot.center.node.snapshot()).detail, what=remedy)
    refused = robot.command("release")
    assert refused.returncode == 1
    assert refused.stderr.strip() == "The button on the robot is pressed: let it out first."
    robot.push_button()

    killed_s = robot.kill("bridge")
    robot.reset_board()
    robot.run("bridge")
    robot.await_sound(killed_s)
    assert robot.motors.stands()
    assert robot.permit.stop_sources == ("button",)
    robot.go_on()


@pytest.mark.requirement("CC_MR_04")
def test_a_release_from_before_a_press_does_not_undo_it_however_often_it_is_repeated(robot: Robot) -> None:
    robot.drive()
    robot.press()
    late = StopRequest(time.monotonic(), SOURCE, latched=False, epoch=robot.permit.stop_epoch)
    robot.go_on()

    def repeated(until_s: float) -> bool:
        robot.center.bus.publish(STOP, late)
        return time.monotonic() > until_s

    with closing(Center(robot.config)) as other:
        until(lambda: other.node.snapshot().look is Look.IDLE, what="the link of the other command center")
        pressed_s = time.monotonic()
        other.node.stop_desk.press()
        until(lambda: repeated(pressed_s + STANDS_FOR_S))
        assert other.node.stop_desk.control.latency_s is not None
        assert other.node.snapshot().look is Look.LATCHED
    assert robot.permit.stop_sources == (SOURCE,)
    robot.go_on()


@pytest.mark.requirement("CC_MR_04")
def test_a_press_while_nothing_is_heard_is_not_confirmed_by_the_stop_of_before_and_acts_once_the_link_is_back(
    robot: Robot,
) -> None:
    relay = Relay(robot.config.mesh.router)
    far_config = replace(robot.config, mesh=replace(robot.config.mesh, router=relay.endpoint))
    with closing(relay), closing(Center(far_config, "client")) as far:
        desk = far.node.stop_desk
        robot.drive()
        robot.press()
        until(lambda: far.node.snapshot().look is Look.LATCHED, what="the stop in the far command center")
        relay.silence()
        assert far.node.snapshot().look is Look.LATCHED
        desk.press()
        assert far.node.snapshot().look is Look.SENT
        robot.go_on()
        assert (desk.control.demand, desk.control.latency_s) == (Demand.STOP, None)
        relay.restore()
        restored_s = time.monotonic()
        robot.motors.dead_after_s(restored_s)
        until(lambda: desk.control.latency_s is not None, what="the confirmation")
        assert robot.permit.stop_sources == (SOURCE,)
    robot.go_on()


@pytest.mark.requirement("CC_MR_04")
def test_a_bridge_that_was_frozen_during_release_and_resume_drives_again_and_is_of_one_mind_with_comm(
    robot: Robot,
) -> None:
    heard: list[tuple[float, Status]] = []
    robot.bus.subscribe(STATUS["bridge"], lambda status: heard.append((time.monotonic(), status)))
    robot.drive()
    robot.press()
    frozen_s = robot.signal("bridge", signal.SIGSTOP)
    # All links to it are given up: what is said now it will never hear
    until(lambda: time.monotonic() > frozen_s + 2 * FREE_LEASE_S)
    robot.release()
    robot.operate(Operation.RESUME)
    thawed_s = robot.signal("bridge", signal.SIGCONT)
    robot.motors.await_driving(thawed_s)
    end_s = time.monotonic() + 2 * DISAGREEMENT_MAX_S
    until(lambda: time.monotonic() > end_s)
    assert disagreement_s(robot, [(t, status) for t, status in heard if t > thawed_s]) < DISAGREEMENT_MAX_S


def disagreement_s(robot: Robot, heard: list[tuple[float, Status]]) -> float:
    """The longest time for which the bridge said something else than the permits of comm."""
    longest_s, since_s = 0.0, None
    for t_s, status in heard:
        granted = [permit.granted for came_s, permit in robot.permits if came_s <= t_s][-1]
        if granted == (status.state == "MOVE"):
            since_s = None
            continue
        since_s = t_s if since_s is None else since_s
        longest_s = max(longest_s, t_s - since_s)
    return longest_s


@pytest.mark.requirement("CC_MR_04")
@pytest.mark.parametrize(("pressed_at_s", "killed_at_s"), [(0.1, 0.0), (0.0, 0.02)])
def test_a_press_around_which_comm_is_killed_stops_the_robot_and_is_sent_until_it_is_confirmed(
    robot: Robot, pressed_at_s: float, killed_at_s: float
) -> None:
    desk = robot.center.node.stop_desk
    robot.drive()
    begun_s = time.monotonic()
    happenings = {pressed_at_s: desk.press, killed_at_s: lambda: robot.kill("comm")}
    for at_s in sorted(happenings):
        time.sleep(max(0.0, begun_s + at_s - time.monotonic()))
        happenings[at_s]()
    robot.run("comm")
    dead_after_s = robot.motors.dead_after_s(begun_s)
    assert dead_after_s < pressed_at_s + STOPPED_WITHIN_S
    robot.await_sound(begun_s)
    until(lambda: desk.control.latency_s is not None, what="the confirmation")
    assert robot.permit.stop_sources
    assert not robot.motors.turned(begun_s + dead_after_s, time.monotonic())
    robot.go_on()


def delete(record: Path) -> None:
    record.unlink()


def damage(record: Path) -> None:
    record.write_bytes(record.read_bytes()[:-10])


def age(record: Path) -> None:
    """As it was a stop before, which was released and resumed."""
    newest = read_record(record)
    assert newest is not None
    write_record(record, replace(newest, epoch=newest.epoch - 1))


@pytest.mark.parametrize(("harm", "source"), [(delete, LOST_RECORD), (damage, LOST_RECORD), (age, RESTART)])
def test_a_stop_record_that_is_lost_damaged_or_too_old_counts_as_a_stop(
    robot: Robot, harm: Callable[[Path], None], source: str
) -> None:
    robot.drive()
    robot.kill("comm")
    harm(robot.folder / RECORD_NAME)
    robot.permits.clear()
    robot.run("comm")
    until(lambda: robot.permits and source in robot.permit.stop_sources, what="the stop after the restart")
    robot.go_on()


def test_a_robot_that_lost_its_power_while_it_drove_stands_until_it_is_released_and_resumed(robot: Robot) -> None:
    robot.drive()
    cut_s = robot.kill("comm", "bridge")
    robot.reset_board()
    robot.run("comm")
    robot.run("bridge")
    robot.await_sound(cut_s)
    assert robot.motors.stands()
    assert robot.permit.stop_sources == (RESTART,)
    robot.go_on()


def test_comm_that_is_told_to_watch_nobody_says_so_in_one_sentence_and_ends_with_2(mesh: Mesh) -> None:
    mesh.config_file.write_text(config_text(replace(mesh.config, comm=CommSection(required=()))), encoding="utf-8")
    comm = mesh.start("comm")
    assert comm.wait(10.0) == 2
    assert comm.stderr is not None
    assert len(comm.stderr.read().decode().strip().splitlines()) == 1
