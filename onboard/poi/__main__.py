"""Process "poi": the points of interest, on the Raspberry Pi."""

import argparse
import sys
from pathlib import Path

from common.board_state import BoardReporter
from common.config import Config
from common.process import run
from onboard.poi.camera.frames_beside import camera_source
from onboard.poi.doors.published import DOORS_NAME, PublishedRecords
from onboard.poi.poi import Poi, reader_of
from onboard.poi.signs.reading_job import reading_beside


def make_poi(config: Config, arguments: argparse.Namespace) -> Poi:
    """Raises StartError when there is no such camera."""
    reading = reading_beside(lambda: reader_of(config.poi))
    folder: Path | None = arguments.log_dir
    board = BoardReporter(Poi.name, folder or Path.cwd())
    published = PublishedRecords(folder / DOORS_NAME if folder else None)
    return Poi(config.poi, camera_source(config.poi.source), reading, board, published)


if __name__ == "__main__":
    sys.exit(run("poi", make_poi))
