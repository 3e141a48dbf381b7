"""What shares comm's process is not lost with it: the spool gives it to the next one."""

from __future__ import annotations

from pathlib import Path

from common.codec import encode
from common.messages.health import Status
from common.messages.topics import POSE, STATUS
from onboard.comm.spool import Spool, spool_folder

BOOT = 7


def message(number: int) -> bytes:
    return encode(Status(0.0, "RUN", 0, 1, True, number), number, BOOT)


def left(folder: Path) -> list[int]:
    return [found.sequence for found in Spool(folder).left()]


def test_a_process_that_died_leaves_what_the_disk_does_not_have(tmp_path: Path) -> None:
    spool = Spool(tmp_path)
    for number in range(1, 4):
        spool.append(STATUS["mmu"].key, message(number))
    found = Spool(tmp_path).left()
    assert [(m.key, m.boot_id, m.sequence, m.data) for m in found] == [
        (STATUS["mmu"].key, BOOT, number, message(number)) for number in range(1, 4)
    ]


def test_what_came_between_the_look_at_the_bus_and_the_turn_stays(tmp_path: Path) -> None:
    spool = Spool(tmp_path)
    spool.append(POSE.key, message(1))  # taken from the bus
    spool.append(POSE.key, message(2))  # came after that
    first = spool.turn()
    spool.append(POSE.key, message(3))
    spool.forget(first)
    assert left(tmp_path) == [1, 2, 3]
    second = spool.turn()
    spool.append(POSE.key, message(4))
    spool.forget(second)
    assert left(tmp_path) == [3, 4]


def test_a_disk_that_refuses_for_long_costs_nothing(tmp_path: Path) -> None:
    spool = Spool(tmp_path)
    for number in range(1, 6):
        spool.append(POSE.key, message(number))
        mark = spool.turn()
    assert left(tmp_path) == [1, 2, 3, 4, 5]
    spool.forget(mark)
    assert left(tmp_path) == [5]


def test_a_second_death_before_the_disk_has_it_loses_nothing(tmp_path: Path) -> None:
    Spool(tmp_path).append(POSE.key, message(1))
    again = Spool(tmp_path)
    assert [found.sequence for found in again.left()] == [1]
    again.append(POSE.key, message(2))
    assert left(tmp_path) == [1, 2]


def test_a_message_that_was_cut_by_the_death_is_left_out(tmp_path: Path) -> None:
    spool = Spool(tmp_path)
    spool.append(POSE.key, message(1))
    spool.append(POSE.key, message(2))
    file = tmp_path / "0"
    file.write_bytes(file.read_bytes()[:-3])
    assert left(tmp_path) == [1]


def test_nothing_is_left_of_one_that_was_closed(tmp_path: Path) -> None:
    folder = tmp_path / "spool"
    spool = Spool(folder)
    spool.append(POSE.key, message(1))
    spool.close()
    assert not folder.exists()


def test_what_is_left_of_a_run_whose_folder_was_removed_is_none_of_the_next_in_its_place(tmp_path: Path) -> None:
    Spool(tmp_path).append(POSE.key, message(1))
    spool = Spool(tmp_path, begins=True)
    assert spool.left() == []
    assert list(tmp_path.iterdir()) == []
    spool.append(POSE.key, message(2))
    assert left(tmp_path) == [2]


def test_a_file_system_that_is_gone_stops_nothing(tmp_path: Path) -> None:
    spool = Spool(tmp_path / "not" / "there")
    spool.append(POSE.key, message(1))
    spool.forget(spool.turn())
    assert spool.left() == []
    spool.close()


def test_two_robots_on_one_machine_have_a_spool_each(tmp_path: Path) -> None:
    folders = {spool_folder(tmp_path / name) for name in ("one", "two")}
    assert len(folders - {None}) in (0, 2)
