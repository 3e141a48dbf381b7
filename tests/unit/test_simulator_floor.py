"""Floor files: what loads, and how every kind of bad file is named."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from offboard.simulator.building.floor import Floor, FloorError, load_floor, parse_floor, wall_segments
from offboard.simulator.building.polygons import contains

OWN_FLOORS = sorted((Path(__file__).parents[2] / "offboard" / "simulator" / "floors").glob("*.json"))


def small_floor() -> dict[str, Any]:
    return {
        "name": "small",
        "units": "m",
        "wall_colour_rgb": [230, 225, 210],
        "corridor": {
            "exterior": [[0, 0], [8, 0], [8, 6], [0, 6]],
            "holes": [[[2, 2], [6, 2], [6, 4], [2, 4]]],
        },
        "doors": [
            {
                "x_m": 4.0,
                "y_m": 0.0,
                "normal_deg": 90.0,
                "width_m": 0.9,
                "height_m": 2.05,
                "colour_rgb": [150, 100, 60],
                "number": "101",
                "room_type": "Office",
                "plate": {
                    "x_m": 4.7,
                    "y_m": 0.0,
                    "on_door": False,
                    "centre_height_m": 1.5,
                    "width_m": 0.2,
                    "height_m": 0.15,
                    "number_height_m": 0.04,
                    "style": "dark on light",
                },
            }
        ],
        "posters": [
            {
                "x_m": 3.0,
                "y_m": 6.0,
                "normal_deg": -90.0,
                "width_m": 0.42,
                "height_m": 0.59,
                "centre_height_m": 1.5,
                "text": "Open day 2019",
            }
        ],
        "starts": [{"x_m": 1.0, "y_m": 1.0, "heading_deg": 0.0}],
    }


def parse(content: Any) -> Floor:
    return parse_floor(content, "floor file small.json")


def test_a_good_floor_loads_with_the_corridor_on_the_left_of_every_wall() -> None:
    floor = parse(small_floor())
    walls = wall_segments(floor)
    assert walls.shape == (8, 4)
    middle = (walls[:, :2] + walls[:, 2:]) / 2
    along = walls[:, 2:] - walls[:, :2]
    left = middle + 0.1 * np.stack([-along[:, 1], along[:, 0]], axis=1) / np.hypot(*along.T)[:, None]
    assert contains(np.array(floor.exterior), left).all()
    assert not contains(np.array(floor.holes[0]), left).any()


def test_rings_may_run_clockwise_or_not_and_repeat_their_first_corner() -> None:
    content = small_floor()
    for ring in (content["corridor"]["exterior"], content["corridor"]["holes"][0]):
        ring.reverse()
        ring.append(ring[0])
    assert {tuple(s) for s in wall_segments(parse(content))} == {tuple(s) for s in wall_segments(parse(small_floor()))}


def test_keys_for_scoring_are_never_read() -> None:
    assert parse(small_floor() | {"halls": "nonsense", "imageable": 3}) == parse(small_floor())


def change(*path: Any, to: Any) -> Callable[[dict[str, Any]], None]:
    def apply(content: Any) -> None:
        for key in path[:-1]:
            content = content[key]
        if to is KeyError:
            del content[path[-1]]
        else:
            content[path[-1]] = to

    return apply


CROSSED = [[0, 0], [8, 6], [8, 0], [0, 5]]
BAD: list[tuple[Callable[[dict[str, Any]], None], str, str]] = [
    (change("units", to="cm"), "units", '"m"'),
    (change("corridor", to=KeyError), "corridor", "missing"),
    (change("doors", 0, "plate", "style", to=KeyError), "doors[0].plate.style", "missing"),
    (change("corridor", "exterior", to=[[0, 0], [8, 0]]), "corridor.exterior", "open polygon"),
    (change("corridor", "exterior", to=[[0, 0], [8, 0], [0, 0], [8, 0]]), "corridor.exterior", "open polygon"),
    (change("corridor", "exterior", to=[[0, 0], [4, 0], [8, 0]]), "corridor.exterior", ""),
    (change("corridor", "exterior", to=CROSSED), "corridor.exterior", "crosses itself"),
    (change("corridor", "exterior", to=[[0, 0], [8, 0], [8, float("nan")]]), "corridor.exterior", "corners"),
    (change("corridor", "holes", 0, 0, to=[-2, 2]), "corridor.holes[0]", "outside"),
    (change("corridor", "holes", 0, to=[[20, 20], [21, 20], [21, 21]]), "corridor.holes[0]", "outside"),
    (change("doors", 0, "y_m", to=0.16), "doors[0]", "from the nearest wall"),
    (change("doors", 0, "plate", "y_m", to=-0.3), "doors[0].plate", "from the nearest wall"),
    (change("posters", 0, "y_m", to=5.5), "posters[0]", "from the nearest wall"),
    (change("doors", 0, "width_m", to="wide"), "doors[0].width_m", "number"),
    (change("doors", 0, "height_m", to=-2), "doors[0].height_m", "greater than 0"),
    (change("doors", 0, "plate", "on_door", to=1), "doors[0].plate.on_door", "true or false"),
    (change("doors", 0, "number", to=101), "doors[0].number", "text"),
    (change("doors", to={}), "doors", "list"),
    (change("doors", 0, to=None), "doors[0]", "object"),
    (change("wall_colour_rgb", to=[1, 2, 300]), "wall_colour_rgb", "0 to 255"),
    (change("starts", to=[]), "starts", "at least one"),
    (change("starts", 0, "x_m", to=-1), "starts[0]", "not inside"),
    (change("starts", 0, to={"x_m": 4, "y_m": 3, "heading_deg": 0}), "starts[0]", "not inside"),
    (change("starts", 0, "y_m", to=0.2), "starts[0]", "from a wall"),
    (change("starts", 0, "x_m", to=True), "starts[0].x_m", "number"),
    (change("starts", 0, "heading_deg", to=10**400), "starts[0].heading_deg", "number"),
    (change("corridor", "exterior", to=[[0, 0], [301, 0], [301, 6], [0, 6]]), "corridor.exterior", "301 m long"),
    (change("corridor", "exterior", to=[[k, 0] for k in range(1001)]), "corridor.exterior", "more than 1000 corners"),
    (change("corridor", "holes", to=[[[2, 2], [6, 2], [6, 4]]] * 400), "corridor", "more than 1000 corners"),
    (change("doors", 0, "plate", "width_m", to=1e4), "doors[0].plate.width_m", "at most 3"),
    (change("posters", 0, "height_m", to=1e-9), "posters[0].height_m", "greater than 0.01"),
]


@pytest.mark.parametrize(("spoil", "key", "complaint"), BAD, ids=[f"{i}-{key}" for i, (_, key, _) in enumerate(BAD)])
def test_a_bad_floor_is_refused_in_one_sentence_with_file_and_key(
    spoil: Callable[[dict[str, Any]], None], key: str, complaint: str
) -> None:
    content = copy.deepcopy(small_floor())
    spoil(content)
    with pytest.raises(FloorError) as caught:
        parse(content)
    message = str(caught.value)
    assert message.startswith("floor file small.json:")
    assert f"'{key}'" in message
    assert complaint in message
    assert "\n" not in message


def test_a_file_that_is_no_json_or_is_not_there_is_named(tmp_path: Path) -> None:
    broken = tmp_path / "broken.json"
    broken.write_text('{"name": ')
    with pytest.raises(FloorError, match=r"broken\.json is not JSON"):
        load_floor(broken)
    with pytest.raises(FloorError, match=r"absent\.json cannot be read"):
        load_floor(tmp_path / "absent.json")
    broken.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FloorError, match=r"broken\.json is not JSON"):
        load_floor(broken)


@pytest.mark.parametrize("path", OWN_FLOORS, ids=lambda path: path.stem)
def test_own_floors_load_and_have_what_a_run_needs(path: Path) -> None:
    floor = load_floor(path)
    assert len(floor.starts) == 3
    assert floor.doors
    assert floor.posters
    assert len({door.number for door in floor.doors}) == len(floor.doors)
    assert "halls" not in json.loads(path.read_text())
