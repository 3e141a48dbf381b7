"""The pose graph at rest: loops close, a wrong closure is outvoted, the first node stays."""

from __future__ import annotations

from math import pi, radians

import numpy as np
import pytest

from common.geometry import FloatArray, Pose2, wrap_angle
from onboard.mmu.back_end.calibration_priors import CalibrationPrior
from onboard.mmu.back_end.pose_graph import PoseGraph

STEP_M = 0.4
SIDE = 12  # steps per side of the square
ODOMETRY = np.diag([0.02**-2, 0.02**-2, radians(1.0) ** -2])
PRIOR = CalibrationPrior(radians(0.1), radians(0.05), 0.01, 0.005)
CLOSURE = np.diag([0.07**-2, 0.07**-2, radians(0.6) ** -2])
DRIFT_RAD = radians(0.25)  # per step: 12 degrees round the square


def square(drift_rad: float = DRIFT_RAD, step_m: float = STEP_M) -> tuple[PoseGraph, list[Pose2]]:
    """The graph of one round with a heading that drifts, and the true poses."""
    graph, truth = PoseGraph(PRIOR), [Pose2(0.0, 0.0, 0.0)]
    graph.add_node(truth[0])
    for i in range(4 * SIDE):
        step = Pose2(step_m, 0.0, pi / 2 if i % SIDE == SIDE - 1 else 0.0)
        truth.append(truth[-1].compose(step))
        drifted = Pose2(step.x_m, step.y_m, step.heading_rad + drift_rad)
        node = graph.add_node(graph.pose(i).compose(drifted))
        graph.odometry.add(i, node, drifted, ODOMETRY)
    return graph, truth


def close(graph: PoseGraph, truth: list[Pose2], first: int, second: int) -> None:
    graph.loop_closures.add(first, second, truth[first].between(truth[second]), CLOSURE)


def worst_m(poses: FloatArray, truth: list[Pose2]) -> float:
    true = np.array([p.as_array() for p in truth])
    return float(np.hypot(*(poses - true)[:, :2].T).max())


def from_first(graph: PoseGraph) -> FloatArray:
    """Poses (K, 3) as seen from the first one."""
    return np.array([graph.pose(0).between(graph.pose(i)).as_array() for i in range(len(graph))])


@pytest.mark.requirement("MMU_MR_03")
def test_a_square_that_drifted_closes() -> None:
    graph, truth = square()
    before_m = worst_m(from_first(graph), truth)
    assert before_m > 0.5
    close(graph, truth, 0, 4 * SIDE)
    chi2_before = graph.loop_closures.chi2(graph.states)[-1]
    assert chi2_before > 10.0
    moved_m = graph.optimise()
    assert moved_m > 0.5
    assert worst_m(from_first(graph), truth) < 0.3 * before_m
    end = graph.pose(0).between(graph.pose(4 * SIDE))
    assert np.hypot(end.x_m, end.y_m) < 0.1
    assert abs(wrap_angle(end.heading_rad)) < radians(2.0)
    assert graph.loop_closures.chi2(graph.states)[-1] < 0.1 * chi2_before


def test_first_node_stays_in_its_place() -> None:
    graph, truth = square()
    close(graph, truth, 0, 4 * SIDE)
    graph.optimise()
    assert graph.poses[0, :2] == pytest.approx([0.0, 0.0])


@pytest.mark.parametrize(("step_m", "first_deg"), [(0.1, 0.0), (40.0, -2.5)])
def test_of_first_heading_and_map_the_one_stays_while_the_map_is_small_and_the_other_later(
    step_m: float, first_deg: float
) -> None:
    graph, truth = square(drift_rad=0.0, step_m=step_m)
    before = graph.poses
    askew = truth[0].compose(Pose2(step_m, 0.0, radians(2.5)))  # the first step turned, by a better constraint
    sharp = np.diag([0.01**-2, 0.01**-2, radians(0.01) ** -2])
    graph.loop_closures.add(0, 1, askew, sharp)
    graph.optimise()
    assert abs(graph.poses[0, 2] - radians(first_deg)) < radians(0.5)
    turned = [p[2] - b[2] for p, b in zip(graph.poses[1:].tolist(), before[1:].tolist(), strict=True)]
    assert wrap_angle(float(np.median(turned))) == pytest.approx(radians(first_deg + 2.5), abs=radians(0.5))


def test_one_wrong_closure_is_outvoted() -> None:
    graph, truth = square()
    for back in range(5):
        close(graph, truth, back, 4 * SIDE - back)
    good, _ = square()
    for back in range(5):
        close(good, truth, back, 4 * SIDE - back)
    good.optimise()
    # One side of the square is taken for the opposite one: 4.8 m off
    graph.loop_closures.add(SIDE // 2, 5 * SIDE // 2, Pose2(0.0, 0.0, pi), CLOSURE)
    graph.optimise()
    assert worst_m(from_first(graph), truth) < worst_m(from_first(good), truth) + 0.15


def test_a_graph_at_rest_stays_however_often_it_is_optimised() -> None:
    graph, truth = square()
    close(graph, truth, 0, 4 * SIDE)
    graph.optimise()
    graph.optimise()
    assert graph.optimise() < 1e-3
    assert len(graph) == 4 * SIDE + 1


def test_headings_stay_within_half_a_turn() -> None:
    graph, truth = square()
    close(graph, truth, 0, 4 * SIDE)
    graph.optimise()
    assert np.abs(graph.poses[:, 2]).max() <= pi


def test_a_constraint_that_knows_one_direction_only_does_not_make_the_graph_singular() -> None:
    graph, truth = square(drift_rad=0.0)
    across = np.zeros((3, 3))
    across[1, 1] = 0.1**-2
    graph.loop_closures.add(0, SIDE - 1, Pose2(99.0, 0.2, 0.0), across)
    graph.optimise()
    poses = from_first(graph)
    assert np.isfinite(poses).all()
    assert poses[SIDE - 1, 0] == pytest.approx(truth[SIDE - 1].x_m, abs=0.05)
    assert 0.0 < poses[SIDE - 1, 1] < 0.2


def test_walls_ahead_show_how_long_the_wheels_are_and_the_map_grows_by_it() -> None:
    longer = 1.006
    rolling = np.diag([0.005**-2, 0.005**-2, radians(0.1) ** -2])
    graph = PoseGraph(PRIOR)
    graph.add_node(Pose2(0.0, 0.0, 0.0))
    for i in range(4 * SIDE):
        step = Pose2(STEP_M, 0.0, pi / 2 if i % SIDE == SIDE - 1 else 0.0)
        node = graph.add_node(graph.pose(i).compose(step))
        graph.odometry.add(i, node, step, rolling, STEP_M, step.heading_rad)
    for side in range(4):
        first, second = side * SIDE + 1, side * SIDE + SIDE - 1
        graph.ranges_to_wall.add(first, second, np.array([1.0, 0.0]), longer * (second - first) * STEP_M, 0.015)
    graph.optimise()
    assert graph.calibration.wheel_scale_error == pytest.approx(longer - 1.0, abs=0.002)
    assert graph.pose(SIDE).x_m == pytest.approx(longer * SIDE * STEP_M, abs=0.01)
    assert graph.calibration.turn_scale_error == pytest.approx(0.0, abs=1e-4)
    assert graph.calibration.drift_rad_per_m == pytest.approx([0.0], abs=1e-4)


def test_right_angles_hold_the_heading_wherever_they_lie_to_the_first_one() -> None:
    graph, truth = square()
    walls_rad = radians(7.0)
    soft_rad = radians(0.5)
    for side in range(4):
        normal_rad = side * pi / 2 + walls_rad
        wall = graph.add_wall(normal_rad + radians(1.0))
        graph.orthogonality.add(wall, side * pi / 2, soft_rad)
        for node in range(side * SIDE, (side + 1) * SIDE, 2):
            graph.wall_directions.add(node, wall, normal_rad - truth[node].heading_rad, soft_rad)
    graph.optimise()
    assert graph.calibration.right_angles_rad == pytest.approx(walls_rad, abs=radians(1.0))
    off_rad = [wrap_angle(h - t.heading_rad) for h, t in zip(from_first(graph)[:, 2].tolist(), truth, strict=True)]
    assert np.abs(off_rad).max() < radians(2.0)


def bent_hall(orthogonal: bool) -> PoseGraph:
    """Straight on by a good gyro; from the middle on ten pieces of one wall show a turn by 1 degree."""
    graph = PoseGraph(CalibrationPrior(radians(0.01), None, 0.004, 0.007))
    graph.add_node(Pose2(0.0, 0.0, 0.0))
    step = Pose2(STEP_M, 0.0, 0.0)
    good = np.diag([0.005**-2, 0.005**-2, radians(0.02) ** -2])
    for i in range(40):
        node = graph.add_node(graph.pose(i).compose(step))
        graph.odometry.add(i, node, step, good, STEP_M, 0.0)
    for bend_deg, first in enumerate((0, 20)):
        wall = graph.add_wall(0.0)
        if orthogonal:
            graph.orthogonality.add(wall, 0.0, radians(0.3))
        for node in range(first, first + 20, 2):
            graph.wall_directions.add(node, wall, radians(bend_deg), radians(0.3))
    graph.optimise()
    return graph


@pytest.mark.parametrize("orthogonal", [False, True])
def test_a_wall_that_bends_a_little_hardly_turns_a_good_gyro_however_many_pieces_show_it(orthogonal: bool) -> None:
    graph = bent_hall(orthogonal)
    assert abs(graph.poses[-1, 2]) < radians(0.25)
    assert graph.calibration.wall_normals_rad == pytest.approx([0.0, radians(1.0)], abs=radians(0.25))


@pytest.mark.parametrize("nodes", [0, 1, 2])
def test_a_graph_without_factors_is_at_rest(nodes: int) -> None:
    graph = PoseGraph(PRIOR)
    for i in range(nodes):
        graph.add_node(Pose2(float(i), 0.0, 0.0))
    assert graph.optimise() == 0.0
    assert graph.poses.shape == (nodes, 3)


def test_the_newest_pose_is_known_by_the_whole_graph_once_it_has_settled_and_by_odometry_since() -> None:
    graph, truth = square()
    by_odometry = graph.newest_covariance()
    sd_m, sd_rad = np.sqrt(np.diag(by_odometry))[[0, 2]]
    assert sd_m > 0.3
    assert sd_rad == pytest.approx(radians(1.0) * (4 * SIDE) ** 0.5)
    close(graph, truth, 0, 4 * SIDE)
    graph.optimise()
    assert np.sqrt(np.diag(graph.newest_covariance())) == pytest.approx([0.07, 0.07, radians(0.6)], rel=0.1)
    node = graph.add_node(graph.pose(4 * SIDE).compose(Pose2(1.0, 0.0, 0.0)))
    graph.odometry.add(node - 1, node, Pose2(1.0, 0.0, 0.0), ODOMETRY)
    along_m, across_m, _ = np.sqrt(np.diag(graph.newest_covariance()))
    assert along_m == pytest.approx(np.hypot(0.07, 0.02), rel=0.1)
    assert across_m == pytest.approx(np.hypot(along_m, radians(0.6)), rel=0.1)
