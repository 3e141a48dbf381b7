"""The process of the visualizer: `python -m offboard.visualizer [--run-dir DIR]`."""

from __future__ import annotations

import argparse
import logging
import sys
from pathlib import Path

from common.clock import FreeClock
from common.config import Config
from common.process import argument_parser, run
from common.zenoh_bus import ZenohBus
from offboard.operate.bus_operator import BusOperator
from offboard.visualizer.feed import Feed
from offboard.visualizer.feed_site import FeedSite
from offboard.visualizer.live_model import ShownRun
from offboard.visualizer.poi_store import RunFolderPois
from offboard.visualizer.server import PageServer
from offboard.visualizer.visualizer import Visualizer


def make_visualizer(config: Config, arguments: argparse.Namespace) -> Visualizer:
    run_dir: Path | None = arguments.run_dir
    feed = Feed() if run_dir is None else Feed(RunFolderPois(run_dir), run=ShownRun(str(run_dir)))
    section = config.visualizer
    operator = BusOperator(lambda: ZenohBus("command_center", config, FreeClock(), "client"), feed.take_operator)
    server = PageServer(FeedSite(feed, config.robot.name, operator), section.host, section.port, section.names)
    logging.getLogger("visualizer").info("page address=%s", server.address)
    return Visualizer(feed, server)


if __name__ == "__main__":
    parser = argument_parser("visualizer")
    parser.add_argument("--run-dir", type=Path, help="run folder of the recorder, for what was found before the start")
    sys.exit(run("visualizer", make_visualizer, parser=parser))
