"""Verb `view`: a recorded run on the page that shows the live one, or in the terminal."""

from __future__ import annotations

import argparse
import threading
from pathlib import Path
from typing import Any

from common.config import VisualizerSection
from common.stop_signals import end_on_signals
from deploy.verbs.records import RUNS_FOLDER


def add_verbs(verbs: Any) -> None:
    view = verbs.add_parser("view", help="a recorded run as a web page with its exports, or in the terminal")
    view.add_argument("folder", metavar="RUN", type=Path, help="run folder, or its name below runs/")
    view.add_argument(
        "--host", default="127.0.0.1", help="address to serve at; 0.0.0.0 for the network too (127.0.0.1)"
    )
    view.add_argument("--port", type=int, default=0, help="port of the page (any free one)")
    view.add_argument(
        "--terminal", action="store_true", help="play it in this terminal, as the Command Center shows it"
    )
    view.set_defaults(run=_view)


def _view(arguments: argparse.Namespace) -> int:
    folder: Path = arguments.folder
    if not folder.is_dir() and (RUNS_FOLDER / folder).is_dir():
        folder = RUNS_FOLDER / folder
    if arguments.terminal:
        from offboard.command_center.replay_app import replay_in_terminal  # here, because the page needs none of it

        return replay_in_terminal(folder)
    from offboard.visualizer.run_view import recorded_run, serve  # here, because the other verbs need none of it

    stop = threading.Event()
    end_on_signals(stop)
    page = VisualizerSection(host=arguments.host, port=arguments.port)
    serve(recorded_run(folder), page, stop, lambda address: print(f"{folder}: {address} (Ctrl-C ends)", flush=True))
    return 0
