"""A run folder + the floor it ran on -> figures: how well the robot located itself, mapped, looked, drove and read.

Two alignments with the truth: at the first pose, as a robot on duty knows itself (`ate_tied_m`, as the scoring scripts
name it), and `fit`, the rigid motion that brings the trajectory best onto the truth, which takes out the heading error
of the first minute. Map, coverage and points of interest are judged in `fit`. Reads trajectory.tum, truth.tum,
map_points.csv and pois.json.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from common.constants import CAMERA_FIELD_OF_VIEW_RAD, CAMERA_INCIDENCE_MAX_RAD, CAMERA_RANGE_M, FOOTPRINT_RADIUS_M
from common.geometry import FloatArray, Points, Pose2, rigid_fit, wrap_angle, wrap_angles
from common.json_reader import Node
from offboard.evaluate.free_space import FreeSpace, Mask, wall_samples
from offboard.runs.run_folder import TRAJECTORY_NAME, TRUTH_NAME, read_map, read_tum

Figures = dict[str, Any]

COVERED_M = 0.30
HALF_VIEW_RAD = CAMERA_FIELD_OF_VIEW_RAD / 2
LOOK_STEP_M, LOOK_STEP_RAD = 0.15, 0.15  # poses nearer to each other show the same
HALL_STEP_M, HALL_REACH_MIN_M, HALL_MARGIN_M = 0.25, 1.0, 0.5
STRAIGHT_SPEED_MIN_M_S, STRAIGHT_TURN_MAX_RAD_S = 0.08, radians(4.0)
RULE_SAMPLES, RULE_SIGHT_M = 6000, 5.0
WIDE_HALL_M, RULE_RIGHT_M, RULE_LEFT_M, RULE_MIDDLE_M = 2.5, 1.4, 0.9, 0.20
DOOR_REACH_M, POSTER_REACH_M = 0.75, 0.6
FAR_M = 1e3  # stands for "never" in the assignment


class EvaluationError(ValueError):
    """The run cannot be evaluated; the message is one sentence with what is missing."""


@dataclass(frozen=True, slots=True)
class _Track:
    """Times (K,) in seconds, and x, y, heading (K, 3)."""

    times_s: FloatArray
    poses: FloatArray

    def at(self, times_s: FloatArray) -> FloatArray:
        """Poses (N, 3) at times (N,), interpolated; the heading is not wrapped."""
        columns = (self.poses[:, 0], self.poses[:, 1], np.unwrap(self.poses[:, 2]))
        return np.column_stack([np.interp(times_s, self.times_s, column) for column in columns])


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _distances_m(offsets: Points) -> FloatArray:
    return np.asarray(np.hypot(offsets[..., 0], offsets[..., 1]))


def _read_track(path: Path) -> _Track:
    if not path.exists():
        raise EvaluationError(f"{path} is missing; only a finished run in simulation can be judged")
    return _Track(*read_tum(path))


def pose_figures(estimate: FloatArray, truth: FloatArray) -> tuple[Figures, Pose2]:
    """Errors of poses (K, 3) at the same times, and the motion into the frame `fit`."""
    fit = rigid_fit(estimate[:, :2], truth[:, :2])
    map_at_start = Pose2(*truth[0]).compose(Pose2(*estimate[0]).inverse())
    error_m = _distances_m(fit.transform(estimate[:, :2]) - truth[:, :2])
    from_start_m = _distances_m(map_at_start.transform(estimate[:, :2]) - truth[:, :2])
    figures = {"ate_fit_m": _rms(error_m), "ate_tied_m": _rms(from_start_m), "error_max_m": float(error_m.max())}
    return figures, fit


def path_figures(truth: FloatArray, space: FreeSpace) -> Figures:
    """Length of the true path, how far from home it ended, and how near a wall it came."""
    away = truth[-1] - truth[0]
    return {
        "path_m": float(_distances_m(np.diff(truth[:, :2], axis=0)).sum()),
        "home_m": float(np.hypot(away[0], away[1])),
        "home_deg": float(np.degrees(abs(wrap_angle(away[2])))),
        "clearance_m": float(space.wall_distance_m(truth[:, :2]).min() - FOOTPRINT_RADIUS_M),
    }


def map_figures(points_m: Points, walls: Points) -> Figures:
    """Distance of the map points (N, 2) from the walls, and the share of the walls that has one near."""
    if not len(points_m):
        return {"map_rmse_m": None, "map_p95_m": None, "map_points": 0, "coverage": 0.0}
    distance_m = np.asarray(cKDTree(walls).query(points_m)[0], dtype=np.float64)
    near = np.asarray(cKDTree(points_m).query(walls)[0], dtype=np.float64) < COVERED_M
    return {
        "map_rmse_m": _rms(distance_m),
        "map_p95_m": float(np.percentile(distance_m, 95)),
        "map_points": len(points_m),
        "coverage": float(near.mean()),
    }


def _looks(truth: FloatArray) -> list[FloatArray]:
    """The poses from which the camera saw something new."""
    kept = [truth[0]]
    for pose in truth[1:]:
        moved = pose - kept[-1]
        if np.hypot(moved[0], moved[1]) > LOOK_STEP_M or abs(wrap_angle(moved[2])) > LOOK_STEP_RAD:
            kept.append(pose)
    return kept


def imaged_share(truth: FloatArray, walls: Points, normals: Points, space: FreeSpace) -> float:
    """Share of the wall samples that a camera looking to the right saw: near, squarely enough, in line of sight."""
    seen: Mask = np.zeros(len(walls), dtype=bool)
    tree = cKDTree(walls)
    for pose in _looks(truth):
        near = np.array(tree.query_ball_point(pose[:2], CAMERA_RANGE_M), dtype=np.int64)
        near = near[~seen[near]]
        offset = walls[near] - pose[:2]
        bearing = wrap_angles(np.arctan2(offset[:, 1], offset[:, 0]) - (pose[2] - np.pi / 2))
        squareness = -(offset * normals[near]).sum(axis=1) / np.maximum(_distances_m(offset), 1e-6)
        near = near[(np.abs(bearing) <= HALF_VIEW_RAD) & (squareness >= np.cos(CAMERA_INCIDENCE_MAX_RAD))]
        seen[near[space.in_sight(pose[:2], walls[near])]] = True
    return float(seen.mean())


def wall_rule_share(track: _Track, space: FreeSpace) -> float | None:
    """Share of straight driving that keeps rule P1.0: the distances in a wide hall, the middle of a narrow one."""
    stride = max(1, len(track.poses) // RULE_SAMPLES)
    poses, times_s = track.poses[::stride], track.times_s[::stride]
    step_s = np.maximum(np.diff(times_s), 1e-6)
    speed_m_s = _distances_m(np.diff(poses[:, :2], axis=0)) / step_s
    turn_rad_s = np.abs(wrap_angles(np.diff(poses[:, 2]))) / step_s
    straight = poses[:-1][(speed_m_s > STRAIGHT_SPEED_MIN_M_S) & (turn_rad_s < STRAIGHT_TURN_MAX_RAD_S)]
    if not len(straight):
        return None
    right_m = space.ray_length_m(straight[:, :2], straight[:, 2] - np.pi / 2)
    left_m = space.ray_length_m(straight[:, :2], straight[:, 2] + np.pi / 2)
    in_hall = (right_m < RULE_SIGHT_M) & (left_m < RULE_SIGHT_M)
    kept = np.where(
        right_m + left_m >= WIDE_HALL_M,
        (right_m >= RULE_RIGHT_M) & (left_m >= RULE_LEFT_M),
        np.abs(right_m - left_m) / 2 <= RULE_MIDDLE_M,
    )
    return float(kept[in_hall].mean()) if in_hall.any() else None


def along(line: Points, first_m: float, step_m: float) -> Points:
    """Points (N, 2) on a polyline, from `first_m` after its start every `step_m`, up to its end."""
    travelled_m = np.concatenate([[0.0], np.cumsum(_distances_m(np.diff(line, axis=0)))])
    stations_m = np.arange(first_m, travelled_m[-1], step_m)
    return np.column_stack([np.interp(stations_m, travelled_m, line[:, axis]) for axis in (0, 1)])


def hall_figures(halls: Node, truth: FloatArray, path_m: float, space: FreeSpace) -> Figures:
    """Share of the centrelines that the true path passed, and its length over twice theirs (`ratio`, what a camera that
    looks to one side needs at least) and over the shortest closed walk through them all (`tour_ratio`)."""
    lines = [halls.points("centrelines", line, at_least=2) for line in halls.items("centrelines")]
    stations = np.concatenate([np.empty((0, 2)), *(along(line, HALL_STEP_M / 2, HALL_STEP_M) for line in lines)])
    if not len(stations):
        raise halls.error("centrelines", "must have a length")
    reach_m = np.maximum(HALL_REACH_MIN_M, space.wall_distance_m(stations) - HALL_MARGIN_M)
    passed = cKDTree(truth[:, :2]).query(stations)[0] <= reach_m
    figures: Figures = {"halls": float(passed.mean()), "ratio": path_m / (2 * halls.length("length_m"))}
    if halls.has("tour_m"):
        figures["tour_ratio"] = path_m / halls.length("tour_m")
    return figures


def letters_of(text: object) -> str:
    """Capitals and digits only."""
    return re.sub(r"[^A-Z0-9]", "", str(text or "").upper())


def _shown(text: object) -> str:
    """Capitals, digits and separators, without spaces."""
    return "".join(str(text or "").upper().split())


def _positions(things: list[dict[str, Any]]) -> Points:
    return np.array([[thing["x_m"], thing["y_m"]] for thing in things], dtype=np.float64).reshape(-1, 2)


def _serve_doors(doors: Points, found: Points) -> list[tuple[int, int, float]]:
    """Which point of interest serves which door, one each, by the least sum of distances: (door, point, metres)."""
    gap_m = _distances_m(doors[:, None] - found[None, :])
    if not gap_m.size:
        return []
    pairs = zip(*linear_sum_assignment(np.where(gap_m < DOOR_REACH_M, gap_m, FAR_M)), strict=True)
    return [(int(a), int(b), float(gap_m[a, b])) for a, b in pairs if gap_m[a, b] < DOOR_REACH_M]


def poi_figures(floor: dict[str, Any], pois: list[dict[str, Any]], found: Points) -> Figures:
    """Doors found and plates read; `found` (N, 2) are the positions of `pois` in the frame `fit`."""
    doors = floor["doors"]
    served = _serve_doors(_positions(doors), found)
    shown = [(_shown(pois[b].get("number")), _shown(doors[a]["number"])) for a, b, _ in served]
    read = [(letters_of(pois[b].get("number")), letters_of(doors[a]["number"])) for a, b, _ in served]
    types = [(letters_of(pois[b].get("room_type")), letters_of(doors[a]["room_type"])) for a, b, _ in served]
    left_over = np.delete(found, [b for _, b, _ in served], axis=0)
    posters = _positions(floor["posters"])
    poster_gap_m = _distances_m(left_over[:, None] - posters[None, :])
    return {
        "doors": len(doors),
        "doors_found": len(served),
        "numbers_exact": sum(number == true for number, true in read),
        "numbers_shown": sum(number == true for number, true in shown),
        "numbers_wrong": sum(bool(number) and number != true for number, true in read),
        "types_shown": sum(bool(door["room_type"]) for door in doors),
        "types_exact": sum(bool(true) and room_type == true for room_type, true in types),
        "false_pois": len(left_over),
        "posters_taken": int((poster_gap_m < POSTER_REACH_M).any(axis=1).sum()),
        "poi_p95_m": float(np.percentile([gap_m for _, _, gap_m in served], 95)) if served else None,
    }


def evaluate(floor_json: dict[str, Any], run_dir: Path) -> Figures:
    """Every figure of a run, lengths in metres (`_m`), shares from 0 to 1; None where there is nothing to judge.

    `halls`, `ratio`, `imaged_of_possible` and `doors_imageable` only where the floor file has the data that they need.
    Raises EvaluationError when trajectory or truth is missing or they have no time in common.
    """
    estimate, truth = _read_track(run_dir / TRAJECTORY_NAME), _read_track(run_dir / TRUTH_NAME)
    common_s = truth.times_s
    if len(estimate.times_s):
        common_s = common_s[(common_s >= estimate.times_s[0]) & (common_s <= estimate.times_s[-1])]
    if not len(estimate.times_s) or not len(common_s):
        raise EvaluationError(f"{run_dir} holds no pose in the time of its truth; let the robot run for some seconds")
    recorded = read_map(run_dir)
    space = FreeSpace(floor_json)
    walls, normals = wall_samples(floor_json, space)
    figures: Figures = {"floor": floor_json["name"]} | path_figures(truth.poses, space)
    errors, fit = pose_figures(estimate.at(common_s), truth.at(common_s))
    figures |= errors | map_figures(fit.transform(recorded.points_m), walls)
    figures["imaged"] = imaged_share(truth.poses, walls, normals, space)
    figures["wall_rule"] = wall_rule_share(truth, space)
    floor = Node(floor_json, "floor file", EvaluationError)
    if floor.has("halls"):
        figures |= hall_figures(floor.child("halls"), truth.poses, figures["path_m"], space)
    if floor.has("imageable"):
        imageable = floor.child("imageable")
        figures["imaged_of_possible"] = figures["imaged"] / imageable.length("wall_share")
        figures["doors_imageable"] = sum(map(bool, imageable.items("plates")))
    return figures | poi_figures(floor_json, recorded.pois, fit.transform(_positions(recorded.pois)))
