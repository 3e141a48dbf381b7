"""The terminal UI over a recorded run: the Command Center's screens, played. No key of it orders anything.

`indoor-mapping view RUN --terminal`.
"""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import ClassVar

from textual.binding import BindingType

from common.errors import StartError, sentence
from common.messages.topics import TOPICS
from offboard.command_center.app import CommandCenterApp
from offboard.command_center.bindings import (
    GENERAL_BINDINGS,
    LOG_BINDINGS,
    REPLAY_BINDINGS,
    REPLAY_HELP,
    Groups,
)
from offboard.command_center.run_player import RunPlayer
from offboard.command_center.screens.replay import MomentScreen, ReplayScreen
from offboard.command_center.snapshot import Snapshot
from offboard.command_center.widgets.run_bar import RunBar
from offboard.command_center.widgets.stop_bar import StopBar
from offboard.command_center.widgets.timeline import moment_text


class ReplayApp(CommandCenterApp, inherit_bindings=False):
    """`clock`: the time that passes for who looks."""

    BINDINGS: ClassVar[list[BindingType]] = [*GENERAL_BINDINGS, *REPLAY_BINDINGS, *LOG_BINDINGS]
    BINDING_GROUPS: ClassVar[Groups] = (REPLAY_BINDINGS, LOG_BINDINGS, GENERAL_BINDINGS)
    HELP_ON_SAFETY: ClassVar[str] = REPLAY_HELP
    main: ReplayScreen

    def __init__(
        self, player: RunPlayer, name: str, export_dir: Path, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.player, self._clock = player, clock
        self._before_s = clock()
        super().__init__(player.node, robot=name, page="", export_dir=export_dir)

    def make_main(self, page: str) -> ReplayScreen:
        # Of a run in lockstep nobody knows the date: its log shows the time since it began
        began_s = self.player.began_wall_s
        return ReplayScreen(page, datetime(2000, 1, 1).timestamp() if began_s is None else began_s, self.jump)

    def make_bar(self) -> StopBar:
        return RunBar(self.action_play)

    @property
    def corner(self) -> str:
        player = self.player
        state = f"playing {player.speed:g}×" if player.playing else f"standing ({player.speed:g}×)"
        return f"{moment_text(player.at_s)} of {moment_text(player.duration_s)}\n{state}"

    def on_mount(self) -> None:
        self.main.log_view.fill(self.player.entries(()))

    def pull(self) -> None:
        now_s = self._clock()
        passed_s, self._before_s = now_s - self._before_s, now_s
        self._of_run(lambda: self.player.advance(passed_s))
        self.node = self.player.node
        super().pull()
        if self.main.is_mounted:
            self.main.timeline.show(self.player.at_s, self.player.duration_s, self.player.moments)
            self.main.log_view.show_until(self.player.at_s)

    def _of_run(self, read: Callable[[], None]) -> None:
        """A database that turns out to be damaged ends it with one sentence."""
        try:
            read()
        except StartError as error:
            self.exit(return_code=2, message=f"indoor-mapping: {sentence(error)}")

    def call_for_help(self, snapshot: Snapshot) -> None:
        """What happened then calls nobody."""

    def jump(self, at_s: float) -> None:
        self._of_run(lambda: self.player.jump(at_s))
        self.pull()
        self._pull_map()

    def show_messages(self, topics: frozenset[str]) -> None:
        shown = [topic for topic in TOPICS if topic.key in topics]
        self._of_run(lambda: self.main.log_view.fill(self.player.entries(shown)))
        self.pull()

    def action_play(self) -> None:
        self._of_run(self.player.play)
        self.pull()

    def action_change_speed(self, steps: int) -> None:
        self.player.change_speed(steps)
        self.pull()

    def action_jump_by(self, seconds: float) -> None:
        self.jump(self.player.at_s + seconds)

    def action_jump_beside(self, direction: int) -> None:
        moment = self.player.moment_beside(direction)
        if moment is not None:
            self.jump(moment.at_s)

    def action_jump_to_line(self) -> None:
        entry = self.main.log_view.marked
        if entry is None:
            self.notify("Mark a line of the log with the arrow keys first.", severity="warning")
            return
        self.jump(entry.arrived_s)
        self.main.log_view.follow(True)

    async def action_go_to_moment(self) -> None:
        def answered(at_s: float | None) -> None:
            if at_s is not None:
                self.jump(at_s)

        await self.push_screen(MomentScreen(self.player.duration_s), answered)


def replay_in_terminal(run_dir: Path) -> int:
    """Until it is left; returns the exit code. Raises StartError without a terminal, RunDatabaseError."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        raise StartError("A run is played in a terminal only; without --terminal it is shown as a web page.")
    logging.basicConfig(handlers=[logging.NullHandler()], force=True)  # a line would be painted over the screen
    player = RunPlayer(run_dir)
    try:
        app = ReplayApp(player, run_dir.resolve().name, Path.cwd())
        app.run()
        return app.return_code or 0
    finally:
        player.close()
