"""What a person asks of a simulated run: every mistake is one sentence."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from common.errors import StartError
from offboard.simulator.run.options import DEFAULT_FLOOR, RunOptions, floor_path, load_world, own_floors


def test_the_default_floor_is_one_of_the_projects_own() -> None:
    assert DEFAULT_FLOOR in own_floors()
    assert floor_path(DEFAULT_FLOOR).is_file()


def test_own_floors_are_found_by_name_and_others_by_path(tmp_path: Path) -> None:
    other = tmp_path / "mine.json"
    other.write_text("{}", encoding="utf-8")
    assert floor_path(str(other)) == other
    with pytest.raises(StartError, match="no floor file nowhere"):
        floor_path("nowhere")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"start": 99}, "has the starts"),
        ({"start": -1}, "has the starts"),
        ({"seed": -1}, "seed"),
        ({"speed": 0.0}, "speed"),
        ({"speed": 1000.0}, "speed"),
        ({"errors": "cruel"}, "error profile"),
        ({"events": Path("nothing.json")}, "nothing.json"),
        ({"floor": Path("nothing.json")}, "nothing.json"),
    ],
)
def test_a_mistake_is_one_sentence(change: dict[str, object], said: str) -> None:
    good = RunOptions(floor=floor_path(DEFAULT_FLOOR))
    load_world(good)
    with pytest.raises(StartError) as caught:
        load_world(replace(good, **change))  # type: ignore[arg-type]
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
