"""A drive through a hall that goes round in a ring, as range logs of every dialect, and how far a map is from it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import inf, isfinite, pi, radians
from pathlib import Path

import numpy as np

from common.geometry import FloatArray, Pose2, rigid_fit
from offboard.runs.run_folder import read_map_points, read_tum

BEARINGS_DEG = (90.0, 45.0, 0.0, -45.0, -90.0)
HEADER = "t_s,odom_x_m,odom_y_m,odom_heading_rad,range0_m,range1_m,range2_m,range3_m,range4_m"
RANGE_MAX_M = 2.5
PERIOD_S = 0.25
STEP_M = 0.07
TURN_RAD = pi / 18
LEGS_M = (2.8, 2.2)
LEGS, ROUND = 2, 6  # a short drive, and one that comes back to where it was
BEGAN_S = 1234500000.0  # what a CARMEN log's clock says
CENTRE = Pose2(0.0, 0.0, 0.0)


def _walls() -> FloatArray:
    """(8, 4): x and y of both ends, of the outer wall and of the block in the middle."""
    rows = []
    for x0, y0, x1, y1 in ((-0.8, -0.8, 3.6, 3.0), (0.8, 0.8, 2.0, 1.4)):
        corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
        rows += [(*a, *b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
    return np.array(rows)


WALLS = _walls()


@cache
def drive(legs: int = LEGS) -> tuple[Pose2, ...]:
    """True poses, which are the odometry too: four legs lead once round."""
    poses = [CENTRE]
    for leg in range(legs):
        moves = [(STEP_M, 0.0)] * round(LEGS_M[leg % 2] / STEP_M) + [(0.0, TURN_RAD)] * 9
        poses += [poses[-1]]
        for way_m, turn_rad in moves:
            poses.append(poses[-1].compose(Pose2(way_m, 0.0, turn_rad)))
    return tuple(poses)


def ranges_m(pose: Pose2, bearings_rad: FloatArray) -> list[float]:
    """Of pencil beams (B,); infinite beyond what the sensor hears."""
    angles_rad = pose.heading_rad + bearings_rad[:, None]
    c, s = np.cos(angles_rad), np.sin(angles_rad)
    along = WALLS[:, 2:] - WALLS[:, :2]
    to = WALLS[:, :2] - [pose.x_m, pose.y_m]
    across = c * along[:, 1] - s * along[:, 0]
    across = np.where(np.abs(across) < 1e-9, 1e-9, across)
    far = (to[:, 0] * along[:, 1] - to[:, 1] * along[:, 0]) / across
    share = (to[:, 0] * s - to[:, 1] * c) / across
    nearest = np.where((far > 0) & (share >= 0) & (share <= 1), far, inf).min(axis=1)
    return [r if r < RANGE_MAX_M else inf for r in nearest.tolist()]


@cache
def heard(legs: int = LEGS) -> tuple[tuple[float, ...], ...]:
    """Ranges of the beams at BEARINGS_DEG, a row per pose of the drive."""
    return tuple(tuple(ranges_m(pose, np.radians(BEARINGS_DEG))) for pose in drive(legs))


def csv_lines(
    stamp: Callable[[int, float], float] = lambda _, t_s: t_s,
    odometry: Callable[[int, Pose2], Pose2] = lambda _, pose: pose,
    silent: str = "",
    scale: float = 1.0,
    legs: int = LEGS,
) -> list[str]:
    """The log in the shared format; `stamp` and `odometry` turn a frame's into others, `silent` is no echo."""
    lines = ["# bearings_deg: 90,45,0,-45,-90", f"# max_range_m: {','.join(5 * [f'{RANGE_MAX_M * scale:g}'])}", HEADER]
    for i, (pose, ranges) in enumerate(zip(drive(legs), heard(legs), strict=True)):
        told = odometry(i, pose)
        cells = [f"{r * scale:.3f}" if isfinite(r) else silent for r in ranges]
        place = f"{told.x_m * scale:.4f},{told.y_m * scale:.4f},{told.heading_rad:.5f}"
        lines.append(f"{stamp(i, i * PERIOD_S):.6f},{place},{','.join(cells)}")
    return lines


@cache
def sweeps(count: int, first_deg: float, step_deg: float, laser: Pose2, silent: str, legs: int) -> tuple[str, ...]:
    """The ranges of a laser on the robot, as words, a line per pose of the drive."""
    bearings_rad = np.radians(first_deg + step_deg * np.arange(count))
    lines = (ranges_m(pose.compose(laser), bearings_rad) for pose in drive(legs))
    return tuple(" ".join(f"{r:.3f}" if isfinite(r) else silent for r in line) for line in lines)


def carmen_lines(
    kind: str = "FLASER",
    sweep: tuple[int, float, float] = (37, -90.0, 5.0),
    laser: Pose2 = CENTRE,
    silent: str = "81.91",
    parameters: tuple[str, ...] = ("robot_front_laser_max 81.9",),
    told: bool = True,
    legs: int = LEGS,
) -> list[str]:
    """A CARMEN log of one laser: `sweep` is count, first angle and step in degrees; `told`: its lines hold its pose."""
    count, first_deg, step_deg = sweep
    lines = ["# CARMEN Logfile", *(f"PARAM {p} nohost 0" for p in parameters)]
    head = f"{kind} {count}"
    if kind != "FLASER":
        head = f"{kind} 0 {radians(first_deg):.6f} {radians(step_deg * (count - 1)):.6f} {radians(step_deg):.6f} "
        head += f"{RANGE_MAX_M:g} 0.01 0 {count}"
    between, tail = ("", "") if kind == "FLASER" else (" 0", " 0.3 0 0.2 0.2 0.1")
    words = sweeps(count, first_deg, step_deg, laser, silent, legs)
    for i, (pose, ranges) in enumerate(zip(drive(legs), words, strict=True)):
        poses = " ".join(
            f"{p.x_m:.4f} {p.y_m:.4f} {p.heading_rad:.5f}" for p in (pose.compose(laser) if told else pose, pose)
        )
        t_s = i * PERIOD_S
        lines.append(f"{head} {ranges}{between} {poses}{tail} {BEGAN_S + t_s:.3f} host {t_s:.3f}")
    return lines


def map_off_m(folder: Path, legs: int) -> tuple[float, int]:
    """The 98th percentile of how far the map's points are from walls, in metres, and how many points there are.

    Once the path is laid on the true one.
    """
    times_s, poses = read_tum(folder / "trajectory_smoothed.tum")
    assert (np.diff(times_s) > 0).all()
    truth = np.array([pose.as_array() for pose in drive(legs)])
    truth = truth[np.round(np.linspace(0, len(truth) - 1, len(poses))).astype(int)]
    points = read_map_points(folder / "map_points.csv")[0]
    points = rigid_fit(poses[:, :2], truth[:, :2]).transform(points)
    along = WALLS[:, 2:] - WALLS[:, :2]
    to = points[:, None] - WALLS[None, :, :2]
    share = np.clip((to * along).sum(-1) / (along**2).sum(-1), 0.0, 1.0)
    off = np.linalg.norm(to - share[..., None] * along, axis=-1).min(axis=1)
    return float(np.percentile(off, 98)) if len(off) else inf, len(off)
