"""The process of the recorder: `python -m offboard.recorder [--run-dir DIR]`."""

from __future__ import annotations

import argparse
import sys
from datetime import datetime
from pathlib import Path

from common.config import Config
from common.process import argument_parser, run
from offboard.recorder.recorder import Recorder

RUNS_FOLDER = Path("runs")


def make_recorder(config: Config, arguments: argparse.Namespace) -> Recorder:
    """Records into the folder of `--run-dir`, else into a new one."""
    now = datetime.now().astimezone()
    return Recorder(arguments.run_dir or RUNS_FOLDER / f"{now:%Y-%m-%d_%H-%M-%S}", now.isoformat(timespec="seconds"))


if __name__ == "__main__":
    parser = argument_parser("recorder")
    parser.add_argument("--run-dir", type=Path, help="the run folder; a run that is there already is continued")
    sys.exit(run("recorder", make_recorder, parser=parser, mode="router"))
