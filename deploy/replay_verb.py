"""Verb `replay`: the mapping unit alone over a range log."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

from common.errors import StartError

BEAM_HALF_WIDTH_DEG = 4.0  # of a log that does not say: a laser's beam is narrower, a small sonar's wider


def add_verbs(verbs: Any) -> None:
    replay = verbs.add_parser("replay", help="the mapping unit alone over a range log (CSV or CARMEN)")
    replay.add_argument("log", type=Path, metavar="LOG", help="shared CSV format or CARMEN log")
    replay.add_argument("--out", type=Path, required=True, help="folder for trajectories and map points")
    replay.add_argument(
        "--beams", type=_angles, metavar="DEG,...", help="which beams, left positive (CARMEN: 90,45,0,-45,-90)"
    )
    replay.add_argument(
        "--beam-half-width",
        type=float,
        default=BEAM_HALF_WIDTH_DEG,
        metavar="DEG",
        help=f"0 for a pencil of light, 38 for a wide sonar ({BEAM_HALF_WIDTH_DEG:g})",
    )
    replay.set_defaults(run=_replay)


def _angles(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(v) for v in text.split(","))
    except ValueError as error:
        raise argparse.ArgumentTypeError("must be angles in degrees with commas between") from error


def _replay(arguments: argparse.Namespace) -> int:
    from offboard.tools.range_log import read_range_log  # here, because it loads the mapping unit
    from offboard.tools.replay import replay, write_replay

    if not 0.0 <= arguments.beam_half_width <= 60.0:
        raise StartError(f"--beam-half-width must be between 0 and 60 degrees, not {arguments.beam_half_width:g}.")
    log = read_range_log(arguments.log, arguments.beams)
    run = replay(log, arguments.beam_half_width)
    write_replay(arguments.out, run)
    step_ms = run.step_s * 1e3
    travel_m = float(np.hypot(*np.diff(log.poses[:, :2], axis=0).T).sum())
    sys.stdout.write(
        f"{len(run.times_s)} frames, {len(log.bearings_rad)} beams, {travel_m:.0f} m of odometry, "
        f"{run.closures} closures, {len(run.points)} map points\n"
        f"processor time of a step: mean {step_ms.mean():.3f} ms, p99.9 {np.percentile(step_ms, 99.9):.2f} ms, "
        f"max {step_ms.max():.2f} ms; "
        f"beside it mean {run.work_s.mean() * 1e3:.2f} ms, max {run.work_s.max() * 1e3:.0f} ms\n"
        f"folder {arguments.out}\n"
    )
    return 0
