"""The process of the Command Center: `python -m offboard.command_center [--config robot.toml]`. It takes the terminal.

Exit codes beyond those of every process: with --owns-mesh, 0 = the mesh shall end too, 3 = it shall go on.
"""

from __future__ import annotations

import argparse
import os
import sys
import threading
import time
from pathlib import Path

from platformdirs import user_log_path

from common.bus import Bus
from common.config import Config
from common.node import Node
from common.process import argument_parser, run
from offboard.command_center.app import CommandCenterApp
from offboard.command_center.command_center import CommandCenter
from offboard.command_center.log_history import logged_before
from offboard.command_center.places import findings_of_run, run_folder_of
from offboard.operate.stop_desk import StopSender

NO_TERMINAL = (
    "command_center: It needs a terminal; without one there are estop, release, start, pause, resume, home and goto.\n"
)


class Terminal:
    """Joins the node of the process with the app that shows it."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._arguments = arguments
        self._config = Config()

    def make_node(self, config: Config, _: argparse.Namespace) -> CommandCenter:
        self._config = config
        run_dir: Path | None = self._arguments.run_dir or run_folder_of(self._arguments.config)
        if run_dir is None:
            return CommandCenter(time.monotonic)
        earlier_log = logged_before(run_dir, time.monotonic(), time.time())
        return CommandCenter(time.monotonic, findings_of_run(run_dir), earlier_log=earlier_log)

    def show(self, node: Node, bus: Bus, stop: threading.Event) -> int:
        assert isinstance(node, CommandCenter)
        page = self._config.visualizer
        sender = StopSender(node.stop_desk, bus)
        sender.start()
        try:
            app = CommandCenterApp(
                node,
                robot=self._config.robot.name,
                page=f"http://{page.host}:{page.port}/",
                export_dir=self._arguments.log_dir,
                owns_mesh=self._arguments.owns_mesh,
                stop=stop,
            )
            app.run()
            return app.return_code or app.return_value or 0
        finally:
            sender.close()


def main() -> int:
    parser = argument_parser("command_center")
    parser.add_argument("--run-dir", type=Path, help="run folder whose doors are known already")
    parser.add_argument("--owns-mesh", action="store_true", help="ask on leaving whether the mesh shall end too")
    parser.set_defaults(log_dir=user_log_path("indoor-mapping", appauthor=False))
    if not (sys.stdin.isatty() and sys.stderr.isatty()) and not {"-h", "--help"} & set(sys.argv):
        sys.stderr.write(NO_TERMINAL)
        return 2
    # Zenoh would write its log over the screen
    os.environ.pop("RUST_LOG", None)
    terminal = Terminal(parser.parse_args())
    return run("command_center", terminal.make_node, parser=parser, foreground=terminal.show)


if __name__ == "__main__":
    sys.exit(main())
