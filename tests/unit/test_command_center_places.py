"""Where `goto` leads, and what the run folder says of doors."""

from __future__ import annotations

from pathlib import Path

import pytest

from deploy.cli import main
from offboard.command_center.places import UnknownPlace, find_place, findings_of_run
from offboard.command_center.snapshot import Finding

DOORS = (Finding("101", 1.0, 2.0), Finding("", 3.0, 4.0))


def test_a_place_is_the_number_of_a_door_or_metres() -> None:
    assert find_place(" 101 ", DOORS) == (1.0, 2.0)
    assert find_place("3.5,-1", DOORS) == (3.5, -1.0)


@pytest.mark.parametrize("text", ["S1|07", "s1 | 07", "S1│07", "-1.05", "−1.05", "12b", "12B"])
def test_a_door_is_found_by_its_shown_form_and_by_its_key(text: str) -> None:
    doors = (Finding("S1|07", 1.0, 1.0), Finding("-1.05", 2.0, 2.0), Finding("12b", 3.0, 3.0))
    assert find_place(text, doors) in {(1.0, 1.0), (2.0, 2.0), (3.0, 3.0)}


ALIKE = {"1.05": 1.0, "10.5": 2.0, "105": 3.0, "-1.05": 4.0, "1.11": 5.0, "11.1": 6.0, "1-11": 7.0, "111": 8.0}


@pytest.mark.parametrize("text", ALIKE)
def test_rooms_that_differ_only_in_separators_never_answer_one_goto(text: str) -> None:
    doors = [Finding(number, x_m, 0.0) for number, x_m in ALIKE.items()]
    assert find_place(text, doors) == (ALIKE[text], 0.0)
    with pytest.raises(UnknownPlace, match="known are"):
        find_place(text, [door for door in doors if door.number != text])


@pytest.mark.parametrize("text", ["nan,0", "0,inf", "1e6,0", "0,-1e400", "1,2,3", "x,y", ",", "102", ""])
def test_what_is_no_place_is_said_in_one_sentence(text: str) -> None:
    with pytest.raises(UnknownPlace) as refused:
        find_place(text, DOORS)
    assert str(refused.value).isprintable()


def test_goto_refuses_no_number_before_it_joins_any_mesh(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["goto", "nan,0"]) == 2
    assert "nan,0" in capsys.readouterr().err


def test_a_sentence_with_words_of_others_in_it_does_not_steer_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["goto", "\x1b]0;title\x07,1"]) == 2
    said = capsys.readouterr().err
    assert said.endswith("\n")
    assert said[:-1].isprintable()


@pytest.mark.parametrize(
    "content",
    [
        "no json",
        "[1]",
        "{}[",
        '[{"poi_id": 1, "number": "1", "x_m": NaN, "y_m": 0}]',
        '[{"poi_id": 1, "number": "1", "x_m": 1e999, "y_m": 0}]',
        '[{"poi_id": 1e999, "number": "1", "x_m": 0, "y_m": 0}]',
        '[{"poi_id": 1}]',
        '{"pois": 7}',
        "\xff",
    ],
)
def test_damaged_records_of_doors_are_told_and_no_doors_are_known(
    content: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "pois.json").write_text(content, encoding="latin-1")
    assert findings_of_run(tmp_path) == {}
    assert "doors of the run unknown" in caplog.text


def test_numbers_of_doors_are_fit_for_a_terminal(tmp_path: Path) -> None:
    (tmp_path / "pois.json").write_text('[{"poi_id": 1, "number": "\\u001b[31m7", "x_m": 1, "y_m": 2}]')
    assert findings_of_run(tmp_path) == {1: Finding("\ufffd[31m7", 1.0, 2.0, number_read="\ufffd[31m7")}
