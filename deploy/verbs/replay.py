"""Verb `replay`: the mapping unit alone over a range log."""

from __future__ import annotations

import argparse
import sys
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from common.errors import StartError

if TYPE_CHECKING:  # loaded when it is needed, because it loads the mapping unit
    from offboard.replay.range_log import RangeLog
    from offboard.replay.replay import Replayed

BEAM_HALF_WIDTH_DEG = 4.0  # of a log without one: a laser's beam is narrower, a small sonar's wider


def add_verbs(verbs: Any) -> None:
    replay = verbs.add_parser("replay", help="the mapping unit alone over a range log (CSV or CARMEN)")
    replay.add_argument("log", type=Path, metavar="LOG", help="shared CSV format or CARMEN log")
    replay.add_argument("--out", type=Path, required=True, help="run folder for it, which `view` plays")
    replay.add_argument(
        "--beams", type=_angles, metavar="DEG,...", help="which beams, left positive (CARMEN: 90,45,0,-45,-90)"
    )
    replay.add_argument(
        "--beam-half-width",
        type=float,
        default=BEAM_HALF_WIDTH_DEG,
        metavar="DEG",
        help=f"0 for a laser, 38 for a wide sonar ({BEAM_HALF_WIDTH_DEG:g})",
    )
    replay.add_argument("--max-range", type=float, metavar="M", help="ranges from here on are no echo")
    replay.add_argument(
        "--field-of-view", type=float, metavar="DEG", help="of a CARMEN log's FLASER, where the log has none (180)"
    )
    replay.set_defaults(run=_replay)


def _angles(text: str) -> tuple[float, ...]:
    try:
        angles = tuple(float(v) for v in text.split(","))
    except ValueError as error:
        raise argparse.ArgumentTypeError("must be angles in degrees with commas between") from error
    if not all(map(isfinite, angles)):
        raise argparse.ArgumentTypeError("must be finite angles")
    return angles


def _check(arguments: argparse.Namespace) -> None:
    if not 0.0 <= arguments.beam_half_width <= 60.0:
        raise StartError(f"--beam-half-width must be between 0 and 60 degrees, not {arguments.beam_half_width:g}.")
    if arguments.max_range is not None and not arguments.max_range > 0.0:
        raise StartError(f"--max-range must be above 0 metres, not {arguments.max_range:g}.")
    if arguments.field_of_view is not None and not 0.0 < arguments.field_of_view <= 360.0:
        raise StartError(f"--field-of-view must be above 0 and up to 360 degrees, not {arguments.field_of_view:g}.")


def _replay(arguments: argparse.Namespace) -> int:
    from offboard.replay.range_log import read_range_log  # here, because it loads the mapping unit
    from offboard.replay.replay import replay, write_replay
    from offboard.replay.replay_record import ReplayRecord

    _check(arguments)
    log = read_range_log(arguments.log, arguments.beams, arguments.max_range, arguments.field_of_view)
    for note in log.notes:
        _print_note(note)
    with ReplayRecord(arguments.out, log) as record:
        run = replay(log, arguments.beam_half_width, record.add)
    write_replay(arguments.out, run)
    for frame in run.loose:
        _print_note(
            f"{arguments.log}, line {log.lines[frame]}: nothing seen from here on was recognised in the map from "
            "before; how the two lie to each other is a guess."
        )
    if not len(run.points):
        _print_note(
            f"{arguments.log}: no wall was found. Scans are {log.step_m:.2f} m apart; a wall shows where four of them "
            "see it within 2 m of way, so record a frame every 0.2 m."
        )
    _report(log, run, arguments.out)
    return 0


def _print_note(sentence: str) -> None:
    sys.stderr.write(f"indoor-mapping: {sentence}\n")


def _report(log: RangeLog, run: Replayed, folder: Path) -> None:
    step_ms = run.step_s * 1e3
    travel_m = float(np.hypot(*np.diff(log.poses[:, :2], axis=0).T).sum())
    sys.stdout.write(
        f"{len(run.times_s)} frames, {len(log.bearings_rad)} beams, {travel_m:.0f} m of odometry, "
        f"{run.closures} closures, {len(run.points)} map points\n"
        f"processor time of a step: mean {step_ms.mean():.3f} ms, p99.9 {np.percentile(step_ms, 99.9):.2f} ms, "
        f"max {step_ms.max():.2f} ms; "
        f"beside it mean {run.work_s.mean() * 1e3:.2f} ms, max {run.work_s.max() * 1e3:.0f} ms\n"
        f"folder {folder}\n"
    )
