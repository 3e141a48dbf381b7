"""Driving along a path that was planned: grid, pose and waypoints in; the point to steer for and the speed out."""

from __future__ import annotations

from math import cos, hypot, radians, sin

from common.geometry import Pose2, wrap_angle
from common.messages.motion import Speed
from onboard.planner.grid.grid_map import GridMap
from onboard.planner.routing.route_planning import straight_is_clear

ARRIVED_M = 0.15
PASSED_WITHIN_M = 0.4  # a waypoint this near counts as passed when it lies behind
FAST_CLEARANCE_M = 0.6
FAST_LENGTH_M = 1.5
FAST_LOOK_AHEAD_M = 1.0
FAST_TURN_RAD = radians(10.0)

Path = list[tuple[float, float]]  # points in the map, metres


def rest_of(path: Path, pose: Pose2) -> Path:
    """The path without the points that were reached or passed; its last point stays. The first is what to steer for."""
    passed = 0
    while passed < len(path) - 1:
        first, second = path[passed], path[passed + 1]
        gap_m = hypot(first[0] - pose.x_m, first[1] - pose.y_m)
        onwards = (second[0] - first[0]) * (pose.x_m - first[0]) + (second[1] - first[1]) * (pose.y_m - first[1])
        if not (gap_m < ARRIVED_M or (onwards > 0.0 and gap_m < PASSED_WITHIN_M)):
            break
        passed += 1
    return path[passed:]


def arrived(path: Path, pose: Pose2) -> bool:
    """Is the last point reached?"""
    return hypot(path[-1][0] - pose.x_m, path[-1][1] - pose.y_m) < ARRIVED_M


def speed_along(path: Path, pose: Pose2, heading_rad: float, grid: GridMap) -> Speed:
    """Fast on a long leg with much room on both sides, where the robot already heads along it."""
    to_go_m = hypot(path[0][0] - pose.x_m, path[0][1] - pose.y_m)
    if to_go_m < FAST_LENGTH_M or abs(wrap_angle(heading_rad - pose.heading_rad)) > FAST_TURN_RAD:
        return Speed.MEDIUM
    ahead = (
        pose.x_m + FAST_LOOK_AHEAD_M * cos(heading_rad),
        pose.y_m + FAST_LOOK_AHEAD_M * sin(heading_rad),
    )
    return Speed.HIGH if straight_is_clear(grid, (pose.x_m, pose.y_m), ahead, FAST_CLEARANCE_M) else Speed.MEDIUM
