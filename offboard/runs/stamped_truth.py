"""The true path of a simulated run with the stamps of the estimates, so that programs that compare paths join them.

The simulator records the truth every 0.1 s on its own; an estimate has the time at which its odometry was measured,
which lies anywhere between two of these. Programs such as evo join poses within 0.01 s only.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from common.geometry import FloatArray, wrap_angles
from offboard.runs.run_folder import SMOOTHED_NAME, TRAJECTORY_NAME, TRUTH_NAME, read_tum, write_tum


def stamp_truth(run_dir: Path) -> None:
    """`truth.tum` has a pose for each one of the estimates too, interpolated; a second time changes nothing."""
    truth = run_dir / TRUTH_NAME
    estimates = [run_dir / name for name in (TRAJECTORY_NAME, SMOOTHED_NAME) if (run_dir / name).exists()]
    if not truth.exists() or not estimates:
        return
    times_s, poses = read_tum(truth)
    stamps_s = np.unique(np.concatenate([read_tum(file)[0] for file in estimates]))
    if len(times_s):
        write_tum(truth, *at_stamps(times_s, poses, stamps_s))


def at_stamps(times_s: FloatArray, poses: FloatArray, stamps_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Times (K,) and poses (K, 3), and those at the stamps (M,) that lie between the first and the last."""
    between_s = stamps_s[(stamps_s >= times_s[0]) & (stamps_s <= times_s[-1])]
    all_s = np.union1d(times_s, between_s)
    columns = (poses[:, 0], poses[:, 1], np.unwrap(poses[:, 2]))
    x_m, y_m, heading_rad = (np.interp(all_s, times_s, column) for column in columns)
    return all_s, np.column_stack([x_m, y_m, wrap_angles(heading_rad)])
