"""What a person said of doors: which record it belongs to, what counts, where it is found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from common.bus import LocalMesh
from common.door_names import CONFIRMED, CORRECTED, DoorNote, Shown, added, note_for, shown
from common.messages.points_of_interest import DoorStatement, DoorStatements, PointOfInterest
from common.messages.topics import DOOR, DOOR_NOTES, POI
from offboard.command_center.command_center import CommandCenter
from offboard.command_center.places import UnknownPlace, find_door, find_place, findings_of_run
from offboard.export.plan import make_plan
from offboard.operate.door_sender import DoorSender
from offboard.operate.operations import Answer
from offboard.runs import run_folder
from tests.unit.export_scenes import hall, write_run

KITCHEN = DoorNote(3, 5.0, 1.0, "241", "Kitchen")


def test_a_statement_follows_its_record_and_else_belongs_to_the_place() -> None:
    assert note_for([KITCHEN], 3, 6.5, 1.0) is KITCHEN, "the map was corrected"
    assert note_for([KITCHEN], 3, 9.0, 1.0) is None, "the records were counted anew: another door"
    assert note_for([KITCHEN], 8, 5.3, 1.0) is KITCHEN, "the same door under another number"
    assert note_for([KITCHEN], 8, 6.0, 1.0) is None


def test_a_newer_statement_replaces_the_one_before_and_an_empty_one_takes_it_back() -> None:
    other = replace(KITCHEN, poi_id=4, x_m=9.0)
    newer = replace(KITCHEN, number="242")
    assert added((KITCHEN, other), newer) == (other, newer)
    assert added((KITCHEN, other), replace(KITCHEN, number="", room_name="")) == (other,)


def test_the_same_number_confirms_and_another_one_corrects() -> None:
    assert shown("2-41", "doubtful", replace(KITCHEN, number="2–41")).judged == CONFIRMED
    assert shown("214", "doubtful", KITCHEN) == Shown("241", "read", "Kitchen", CORRECTED)
    assert shown("", "unread", replace(KITCHEN, number="")) == Shown("", "unread", "Kitchen")


def named_run(folder: Path) -> Path:
    data = hall()
    record = {"poi_id": 7, "number": "241", "number_read": "214", "room_name": "Green Room", "judged": CORRECTED}
    return write_run(folder, replace(data, pois=[data.pois[0] | record]))


def test_goto_finds_a_door_by_the_number_that_counts_and_by_its_name(tmp_path: Path) -> None:
    findings = findings_of_run(named_run(tmp_path / "run"))
    for text in ("241", "green  room", "#7"):
        assert find_door(text, findings)[0] == 7
        assert find_place(text.replace("#7", "241"), findings.values()) == (3.0, -1.0)
    with pytest.raises(UnknownPlace, match="known are 241"):
        find_door("214", findings)


def test_drawings_show_the_name_in_place_of_the_room_type(tmp_path: Path) -> None:
    texts = [text.text for text in make_plan(run_folder.read_map(named_run(tmp_path / "run"))).texts]
    assert "Green Room" in texts
    assert "241" in texts
    assert "Lab" not in texts


def test_the_terminal_knows_what_was_said_of_doors_found_before_and_after() -> None:
    mesh = LocalMesh()
    center, bus, others = CommandCenter(lambda: mesh.now_s), mesh.endpoint("command_center"), mesh.endpoint("others")
    center.step(bus, 0.0)
    others.publish(POI, PointOfInterest(0.0, 3, "Door", "", 5.0, 1.0, "214", "", 0.9, "read"))
    others.publish(DOOR_NOTES, DoorStatements(0.0, 1, (3,), (5.0,), (1.0,), ("241",), ("Kitchen",)))
    center.step(bus, 0.1)
    others.publish(POI, PointOfInterest(0.0, 3, "Door", "", 5.1, 1.0, "215", "", 0.9, "read"))
    center.step(bus, 0.2)
    assert find_place("kitchen", center.snapshot().findings) == (5.1, 1.0)
    assert find_place("241", center.snapshot().findings) == (5.1, 1.0)


def test_a_statement_is_repeated_until_the_recorder_has_it() -> None:
    mesh = LocalMesh()
    person, recorder = mesh.endpoint("command_center"), mesh.endpoint("recorder")
    recorder.take(DOOR)
    sender = DoorSender(lambda bits: 77)
    sender.step(person, 0.0)
    sender.give(0.0, 3, (5.0, 1.0), "241", "")
    answers = [sender.step(person, k / 20) for k in range(10)]
    assert set(answers) == {Answer.WAITING}
    sent: list[DoorStatement] = recorder.take(DOOR)
    assert len(sent) > 2
    assert {statement.command_id for statement in sent} == {77}
    recorder.publish(DOOR_NOTES, DoorStatements(0.0, 77, (), (), (), (), ()))
    assert sender.step(person, 0.6) is Answer.TAKEN
    assert sender.step(person, 0.7) is None
    sender.give(1.0, 3, (5.0, 1.0), "242", "")
    sender = DoorSender(lambda bits: 78)
    sender.give(1.0, 3, (5.0, 1.0), "242", "")
    assert sender.step(person, 9.0) is Answer.NONE
