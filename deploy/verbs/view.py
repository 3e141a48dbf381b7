"""Verb `view`: recorded runs on the page that shows the live one, or one in the terminal."""

from __future__ import annotations

import argparse
import threading
from pathlib import Path
from typing import Any

from common.config import VisualizerSection
from common.errors import StartError
from common.stop_signals import end_on_signals
from deploy.verbs.records import RUNS_FOLDER


def add_verbs(verbs: Any) -> None:
    view = verbs.add_parser(
        "view", help="recorded runs as pages: a list, one, or two over each other; one in the terminal"
    )
    view.add_argument(
        "runs",
        metavar="RUN",
        nargs="*",
        type=Path,
        help="run folder, or its name below runs/; a second lies over it; of a folder of runs the list (runs/)",
    )
    view.add_argument(
        "--host", default="127.0.0.1", help="address to serve at; 0.0.0.0 for the network too (127.0.0.1)"
    )
    view.add_argument("--port", type=int, default=0, help="port of the page (any free one)")
    view.add_argument(
        "--terminal", action="store_true", help="play it in this terminal, as the Command Center shows it"
    )
    view.set_defaults(run=_view)


def _view(arguments: argparse.Namespace) -> int:
    runs = [folder if folder.is_dir() else _below_runs(folder) for folder in arguments.runs or [RUNS_FOLDER]]
    if len(runs) > (1 if arguments.terminal else 2):
        raise StartError("The terminal shows one run, the page at most two over each other.")
    if arguments.terminal:
        from offboard.command_center.replay_app import replay_in_terminal  # here, because the page needs none of it

        return replay_in_terminal(runs[0])
    # Here, because the other verbs need none of it
    from offboard.visualizer.run_library import RunLibrary, is_library, run_site
    from offboard.visualizer.run_view import serve_site

    site = RunLibrary(runs[0]) if len(runs) == 1 and is_library(runs[0]) else run_site(*runs)
    stop = threading.Event()
    end_on_signals(stop)
    page = VisualizerSection(host=arguments.host, port=arguments.port)
    shown = " under ".join(map(str, runs))
    serve_site(site, page, stop, lambda address: print(f"{shown}: {address} (Ctrl-C ends)", flush=True))
    return 0


def _below_runs(folder: Path) -> Path:
    return RUNS_FOLDER / folder if (RUNS_FOLDER / folder).is_dir() else folder
