"""The figures of a run on a floor whose truth is plain to see: a hall of 20 m by 3 m, driven along its middle."""

from __future__ import annotations

import json
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common.geometry import Pose2
from common.messages.mission import Outcome
from offboard.evaluate.figures import EvaluationError, along, evaluate
from offboard.evaluate.summary import RunFacts, StepTimes, without_wall_time, write_summary
from offboard.runs import run_folder


def door(x_m: float, y_m: float, number: str, room_type: str = "") -> dict[str, Any]:
    return {"x_m": x_m, "y_m": y_m, "number": number, "room_type": room_type}


FLOOR: dict[str, Any] = {
    "name": "hall",
    "corridor": {"exterior": [[0, 0], [20, 0], [20, 3], [0, 3]], "holes": []},
    "doors": [door(5, 0, "101 A", "Office"), door(10, 0, "102"), door(15, 3, "103", "Lab")],
    "posters": [{"x_m": 7.0, "y_m": 3.0}],
    "halls": {"length_m": 18.0, "centrelines": [[[1, 1.5], [10, 1.5], [19, 1.5]]]},
    "imageable": {"wall_share": 0.8, "plates": [True, True, False]},
}
TIMES_S = np.arange(181) * 0.5
START = Pose2(1.0, 1.5, 0.0)


def drive(y_m: float = 1.5, until_m: float = 19.0, heading_rad: float = 0.0) -> np.ndarray:
    xs = np.linspace(1.0, until_m, len(TIMES_S))
    return np.column_stack([xs, np.full(len(xs), y_m), np.full(len(xs), heading_rad)])


def both_walls() -> np.ndarray:
    xs = np.arange(0.0, 20.0, 0.1)
    return np.concatenate([np.column_stack([xs, np.full(len(xs), y)]) for y in (0.0, 3.0)])


def write_run(
    folder: Path,
    truth: np.ndarray,
    walls: np.ndarray,
    pois: list[dict[str, Any]],
    map_from_floor: Pose2 | None = None,
) -> Path:
    """A run that made no error: what it tells is the truth, seen from its own start."""
    frame = map_from_floor or START.inverse()
    own = [frame.compose(Pose2(*row)).as_array() for row in truth]
    folder.mkdir(exist_ok=True)
    run_folder.write_tum(folder / run_folder.TRUTH_NAME, TIMES_S, truth)
    run_folder.write_tum(folder / run_folder.TRAJECTORY_NAME, TIMES_S, np.array(own))
    run_folder.write_map_points(
        folder / run_folder.MAP_POINTS_NAME, frame.transform(walls), np.zeros(len(walls), np.uint8)
    )
    placed = [poi | dict(zip(("x_m", "y_m"), frame.transform([poi["x_m"], poi["y_m"]]), strict=True)) for poi in pois]
    run_folder.write_json(folder / run_folder.POIS_NAME, placed)
    return folder


def test_run_without_errors_has_none(tmp_path: Path) -> None:
    figures = evaluate(FLOOR, write_run(tmp_path, drive(), both_walls(), []))
    for name in ("ate_fit_m", "ate_tied_m", "error_max_m", "map_rmse_m", "home_deg"):
        assert figures[name] == pytest.approx(0.0, abs=0.03), name
    assert figures["path_m"] == pytest.approx(18.0, abs=1e-3)
    assert figures["home_m"] == pytest.approx(18.0, abs=1e-3)
    assert figures["clearance_m"] == pytest.approx(1.0 - 0.22, abs=0.06)
    assert figures["ratio"] == pytest.approx(0.5)
    assert figures["halls"] == 1.0
    assert figures["floor"] == "hall"
    json.dumps(figures)


def test_wrong_first_heading_costs_the_tied_figure_only(tmp_path: Path) -> None:
    turned = Pose2(0.0, 0.0, 0.1).compose(START.inverse())
    figures = evaluate(FLOOR, write_run(tmp_path, drive(), both_walls(), [], turned))
    assert figures["ate_fit_m"] == pytest.approx(0.0, abs=1e-3)
    assert figures["ate_tied_m"] == pytest.approx(0.0, abs=1e-3)
    run_folder.write_tum(tmp_path / run_folder.TRAJECTORY_NAME, TIMES_S, drive(heading_rad=0.1))
    figures = evaluate(FLOOR, tmp_path)
    assert figures["ate_fit_m"] == pytest.approx(0.0, abs=1e-3)
    assert figures["ate_tied_m"] == pytest.approx(0.1 * 18 / 3**0.5, rel=0.02)


def test_coverage_is_the_share_of_walls_with_a_point_near(tmp_path: Path) -> None:
    lower = both_walls()[:200]
    figures = evaluate(FLOOR, write_run(tmp_path, drive(), lower, []))
    assert figures["coverage"] == pytest.approx((20 + 2 * 0.3) / 46, abs=0.02)


def test_camera_images_the_wall_on_its_right_only(tmp_path: Path) -> None:
    eastward = evaluate(FLOOR, write_run(tmp_path, drive(), both_walls(), []))
    assert eastward["imaged"] == pytest.approx((18 + 2 * 1.5 * np.tan(0.47)) / 46, abs=0.02)
    assert eastward["imaged_of_possible"] == pytest.approx(eastward["imaged"] / 0.8)
    northward = drive(heading_rad=pi / 2)
    assert evaluate(FLOOR, write_run(tmp_path, northward, both_walls(), []))["imaged"] < 0.1


@pytest.mark.parametrize(("y_m", "share"), [(1.6, 1.0), (1.2, 0.0), (2.3, 0.0)])
def test_wide_hall_wants_its_distances_to_both_walls(tmp_path: Path, y_m: float, share: float) -> None:
    assert evaluate(FLOOR, write_run(tmp_path, drive(y_m), both_walls(), []))["wall_rule"] == share


def test_standing_robot_has_no_wall_rule(tmp_path: Path) -> None:
    figures = evaluate(FLOOR, write_run(tmp_path, drive(until_m=1.0), both_walls(), []))
    assert figures["wall_rule"] is None
    assert figures["halls"] < 0.2


def test_points_of_interest_are_given_to_doors_one_by_one(tmp_path: Path) -> None:
    pois = [
        door(5.1, 0.0, "101a", "office"),
        door(5.3, 0.0, "101A"),  # a second point for one door
        door(10.2, 0.1, "107"),
        door(7.1, 2.9, ""),  # the poster
    ]
    figures = evaluate(FLOOR, write_run(tmp_path, drive(), both_walls(), pois))
    expected = {
        "doors": 3,
        "doors_found": 2,
        "numbers_exact": 1,
        "numbers_shown": 1,
        "numbers_wrong": 1,
        "types_shown": 2,
        "types_exact": 1,
        "false_pois": 2,
        "posters_taken": 1,
        "doors_imageable": 2,
    }
    assert {name: figures[name] for name in expected} == expected
    assert figures["poi_p95_m"] == pytest.approx(0.218, abs=0.005)


def test_number_is_shown_rightly_with_its_separators_only(tmp_path: Path) -> None:
    floor = FLOOR | {"doors": [dict(FLOOR["doors"][0], number="1.05")]}
    for number, exact, shown in (("1.05", 1, 1), ("105", 1, 0), ("10.5", 1, 0), ("1.06", 0, 0)):
        folder = tmp_path / number
        folder.mkdir()
        figures = evaluate(floor, write_run(folder, drive(), both_walls(), [door(5.1, 0.0, number)]))
        assert (figures["numbers_exact"], figures["numbers_shown"]) == (exact, shown)


def test_run_that_found_nothing_is_judged_all_the_same(tmp_path: Path) -> None:
    figures = evaluate(FLOOR, write_run(tmp_path, drive(), np.empty((0, 2)), []))
    assert (figures["coverage"], figures["map_rmse_m"], figures["doors_found"], figures["poi_p95_m"]) == (
        0,
        None,
        0,
        None,
    )


def test_floor_without_centrelines_gives_no_hall_figures(tmp_path: Path) -> None:
    bare = {key: value for key, value in FLOOR.items() if key not in ("halls", "imageable")}
    figures = evaluate(bare, write_run(tmp_path, drive(), both_walls(), []))
    assert not {"halls", "ratio", "imaged_of_possible", "doors_imageable"} & set(figures)


def test_run_without_truth_is_refused_with_a_sentence(tmp_path: Path) -> None:
    write_run(tmp_path, drive(), both_walls(), [])
    (tmp_path / run_folder.TRUTH_NAME).unlink()
    with pytest.raises(EvaluationError, match=r"truth\.tum is missing"):
        evaluate(FLOOR, tmp_path)


def test_stations_on_a_line_turn_its_corners() -> None:
    corner = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    np.testing.assert_allclose(along(corner, 0.5, 1.0), [[0.5, 0.0], [1.0, 0.5]])
    assert len(along(corner[:1].repeat(2, axis=0), 0.125, 0.25)) == 0


def facts(wall_time_s: float) -> RunFacts:
    steps = {"mmu": StepTimes.of([wall_time_s, 2 * wall_time_s])}
    return RunFacts("hall", 3, 0, {"speed": 2}, Outcome.FINISHED, "all halls done", 90.0, wall_time_s, steps)


def test_summary_holds_facts_and_figures(tmp_path: Path) -> None:
    write_run(tmp_path, drive(), both_walls(), [])
    summary = write_summary(tmp_path, facts(1.0), FLOOR)
    assert json.loads((tmp_path / "summary.json").read_text()) == summary
    assert summary["reason"] == "all halls done"
    assert summary["halls"] == 1.0
    assert summary["steps"]["mmu"] == {"mean_ms": 1500.0, "p99_ms": 1990.0, "p999_ms": 1999.0, "max_ms": 2000.0}


def test_summaries_of_one_seed_differ_in_wall_time_only(tmp_path: Path) -> None:
    write_run(tmp_path, drive(), both_walls(), [])
    a, b = (write_summary(tmp_path, facts(wall_time_s), FLOOR) for wall_time_s in (1.0, 2.0))
    assert a != b
    assert without_wall_time(a) == without_wall_time(b)


def test_summary_of_a_run_that_cannot_be_judged_says_why(tmp_path: Path) -> None:
    summary = write_summary(tmp_path, facts(1.0), FLOOR)
    assert "trajectory.tum is missing" in summary["not_evaluated"]


@pytest.mark.parametrize(
    ("damaged", "said"),
    [
        ({"halls": {}}, "key 'halls.centrelines' is missing"),
        ({"halls": {"centrelines": [[[1, 1]]], "length_m": 1}}, "key 'halls.centrelines' must have at least 2 points"),
        ({"halls": {"centrelines": [], "length_m": 1}}, "key 'halls.centrelines' must have a length"),
        ({"halls": FLOOR["halls"] | {"length_m": 0}}, "key 'halls.length_m' must be greater than 0"),
        ({"imageable": {"wall_share": "all", "plates": []}}, "key 'imageable.wall_share' must be a number"),
    ],
)
def test_floor_whose_keys_for_scoring_are_damaged_costs_the_figures_and_not_the_summary(
    damaged: dict[str, Any], said: str, tmp_path: Path
) -> None:
    write_run(tmp_path, drive(), both_walls(), [])
    assert said in write_summary(tmp_path, facts(1.0), FLOOR | damaged)["not_evaluated"]
