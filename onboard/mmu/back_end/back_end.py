"""The back end: keyframes and echoes in, corrected poses of all of them out. Runs beside the mapping unit's steps.

1. Odometry joins the keyframes in the pose graph (`keyframe_graph`).
2. Constraints are searched for: `sequential_matching`, `wall_association`, `walls_ahead`, `loop_closure`.
3. The graph is optimised when it gained a constraint that pulls.

Where it turns out that no gyro leads odometry, all of it begins anew with what was received until then.
"""

from __future__ import annotations

from math import degrees

from onboard.mmu.back_end.exchange import Correction, Increment
from onboard.mmu.back_end.keyframe_graph import KeyframeGraph
from onboard.mmu.back_end.loop_closure import LoopClosure
from onboard.mmu.back_end.odometry_noise import GYRO_LED, UNKNOWN, WHEELS_ALONE, OdometryNoise
from onboard.mmu.back_end.pose_graph import Mark
from onboard.mmu.back_end.sequential_matching import SequentialMatching
from onboard.mmu.back_end.wall_association import WallAssociation
from onboard.mmu.back_end.walls_ahead import WallsAhead
from onboard.mmu.map.keyframes import ObservationStore

# How often constraints are searched for and the graph is optimised. The sensitivity was not measured
MATCH_EVERY_M = 1.0  # of path
CHI2_MAX = 0.5  # new constraints whose chi-squared is smaller need no optimisation yet
CALIBRATION_LOG_M = 10.0  # of path between two lines about the calibration


class BackEnd:
    """`gyro_led` false: it is not known whether a gyro leads odometry's heading, and found out from the walls."""

    def __init__(self, gyro_led: bool = True) -> None:
        self._received: list[Increment] = []  # as long as it is not known
        self._begin(GYRO_LED if gyro_led else UNKNOWN)

    def _begin(self, noise: OdometryNoise) -> None:
        self._keyframes = KeyframeGraph(noise)
        self._sequential = None if noise is GYRO_LED else SequentialMatching(self._keyframes)
        self._loop_closure = LoopClosure(self._keyframes)
        self._walls = WallAssociation(self._keyframes)
        self._walls_ahead = WallsAhead(self._keyframes, self._walls)
        self._matched_m = 0.0
        self._logged_m = 0.0

    @property
    def echoes(self) -> ObservationStore:
        """All that were taken in."""
        return self._keyframes.echoes

    def take(self, increment: Increment) -> Correction:
        """One round of work on what is new."""
        log_lines = self._take_in(increment)
        if self._keyframes.noise is UNKNOWN:
            self._received.append(increment)
            log_lines += self._judge_odometry()
        graph = self._keyframes.graph
        return Correction(
            graph.poses,
            float(graph.calibration.drift_rad_per_m[-1]),
            graph.calibration.turn_scale_error,
            self._loop_closure.count,
            self._keyframes.closure_path_m,
            graph.newest_covariance(),
            log_lines=tuple(log_lines),
        )

    def _judge_odometry(self) -> list[str]:
        """Begins anew where no gyro leads odometry, as the walls beside the path or the loop closures show."""
        if self._sequential is not None and self._sequential.walls_turn:
            reason = "walls turn as the robot drives along them"
        elif self._loop_closure.contradicted:
            reason = "most loop closures contradict it"
        else:
            return []
        lines = [f"odometry distrusted: {reason}, so no gyro leads the heading"]
        received, self._received = self._received, []
        self._begin(WHEELS_ALONE)
        for increment in received:
            lines += self._take_in(increment)
        return lines

    def _take_in(self, increment: Increment) -> list[str]:
        """Lines for the log."""
        keyframes = self._keyframes
        for keyframe in increment.keyframes:
            keyframes.add(keyframe, increment.prior_map)
        if any(keyframe.stated is not None for keyframe in increment.keyframes):
            keyframes.graph.optimise()
        keyframes.echoes.append(increment.echoes)
        if increment.prior_map:
            self._matched_m = keyframes.closure_path_m = keyframes.path_m
        elif len(keyframes):
            return self._constrain(increment)
        return []

    def _constrain(self, increment: Increment) -> list[str]:
        """Search for constraints between what is new and what is known, and optimise the graph; lines for the log."""
        mark = self._keyframes.graph.mark()
        self._walls_ahead.observe(increment.ranges_to_wall)
        if self._sequential is not None:
            self._sequential.measure_turn()
            self._sequential.match_newest()
        self._settle(mark)
        if self._keyframes.path_m - self._matched_m >= MATCH_EVERY_M:
            self._matched_m = self._keyframes.path_m
            mark = self._keyframes.graph.mark()
            self._observe_walls()
            self._loop_closure.search()
            self._settle(mark)
            self._loop_closure.adopt()
        return [*self._loop_closure.take_log(), *self._calibration_line()]

    def _observe_walls(self) -> None:
        self._walls_ahead.forget_old()
        for piece in self._walls.observe():
            self._walls_ahead.meet(piece)

    def _settle(self, since: Mark) -> None:
        """Optimise where one of the constraints newer than `since` pulls."""
        if self._keyframes.graph.worst_chi2(since) > CHI2_MAX:
            self._keyframes.graph.optimise(since)

    def _calibration_line(self) -> list[str]:
        """What odometry's systematic errors are estimated to be, every few metres of path."""
        keyframes, calibration = self._keyframes, self._keyframes.graph.calibration
        if keyframes.path_m - self._logged_m < CALIBRATION_LOG_M:
            return []
        self._logged_m = keyframes.path_m
        return [
            f"calibration path_m={keyframes.path_m:.0f} wheel_scale_error={calibration.wheel_scale_error:+.4f}"
            f" turn_scale_error={calibration.turn_scale_error:+.4f}"
            f" drift_deg_per_m={degrees(calibration.drift_rad_per_m[-1]):+.4f}"
            f" right_angles={'yes' if self._walls.square else 'no'}"
            f" direction_deg={degrees(calibration.right_angles_rad):+.2f}"
        ]
