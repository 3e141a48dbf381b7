"""Dead reckoning over a run: the pose in `odom`, the recent poses that ranges are dated with, and the path so far."""

from __future__ import annotations

from common.geometry import Pose2, wrap_angle
from common.messages.motion import Odometry
from onboard.mmu.front_end.odometry import OdometryFilter

# The sensitivity was not measured
PATH_M_PER_RAD = 0.6  # a robot that turns on the spot has as much new in view as one that drives so far
POSES_KEPT = 60  # of recent odometry: six seconds of it


class DeadReckoning:
    """`update` or `move` takes the newest motion in, `advance` dates it."""

    def __init__(self, track_m: float, tick_m: float) -> None:
        self.filter = OdometryFilter(track_m, tick_m)
        self.board: Odometry | None = None  # the newest report that was taken in
        self.recent: list[tuple[float, Pose2]] = []  # times and poses, the newest last
        self.travel_m = 0.0
        self.path_m = 0.0  # travel and turning together: how much new was in view

    @property
    def pose(self) -> Pose2:
        return self.filter.pose

    def update(self, odometry: Odometry) -> tuple[bool, bool]:
        """Takes one report in. Returns whether it continues the one before, and whether it is to be advanced by.

        The first report of a board continues nothing, and is to be advanced by.
        """
        first = self.board is None or odometry.session != self.board.session
        continues = self.filter.update(odometry)
        if continues or first:
            self.board = odometry
        return continues, continues or first

    def move(self, moved: Pose2, certain: bool) -> None:
        """The carrier is at `moved`, as seen from where it was; not `certain`: that is a guess."""
        self.filter.move(moved)
        if not certain:
            self.filter.kidnapped = True
            self.recent.clear()

    def place(self, pose: Pose2) -> None:
        """The robot was carried to that pose in `odom`, which is no path."""
        self.filter.begin_at(pose)
        self.filter.kidnapped = True
        self.recent.clear()

    def advance(self, t_s: float) -> None:
        """The newest motion ended at that time."""
        pose = self.pose
        if self.recent:
            last = self.recent[-1][1]
            driven_m = last.distance_m(pose)
            self.travel_m += driven_m
            self.path_m += driven_m + PATH_M_PER_RAD * abs(wrap_angle(pose.heading_rad - last.heading_rad))
        self.recent.append((t_s, pose))
        del self.recent[:-POSES_KEPT]

    def continue_from(self, pose: Pose2, travel_m: float, path_m: float) -> None:
        """`odom` continues at the end of a prior map."""
        self.filter.begin_at(pose)
        self.travel_m, self.path_m = travel_m, path_m
