"""The main screen: modules and robot above, the log below."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise
from typing import ClassVar

from textual import on
from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import Horizontal
from textual.screen import Screen
from textual.widgets import Footer, Input

from common.modules import PACKAGES, publisher_of
from offboard.command_center.log_book import LEVELS, LogBook, LogEntry, LogFilter
from offboard.command_center.screens.guarded import Guarded
from offboard.command_center.snapshot import FloorPicture, Snapshot
from offboard.command_center.widgets.board_lines import BoardLines
from offboard.command_center.widgets.field import Field
from offboard.command_center.widgets.log_view import LogView
from offboard.command_center.widgets.map_panel import MapPanel
from offboard.command_center.widgets.module_table import ModuleTable
from offboard.command_center.widgets.robot_panel import RobotPanel
from offboard.command_center.widgets.trouble import Trouble


class MainScreen(Guarded, Screen[None]):
    """Holds the filter of the log; everything else is shown as it is given."""

    BINDINGS: ClassVar[list[BindingType]] = [("escape", "to_log", "")]

    def __init__(self, page: str, wall_offset_s: float) -> None:
        """`wall_offset_s`: from the clock by which log lines arrive to wall time."""
        super().__init__()
        self.modules = ModuleTable()
        self.robot = RobotPanel(page)
        self.trouble = Trouble()
        self.boards = BoardLines()
        self.map = MapPanel()
        self.log_view = LogView(LogBook(), wall_offset_s)
        self.search = Field(placeholder="regular expression; enter keeps it, esc clears it", id="search")

    def compose(self) -> ComposeResult:
        yield self.make_bar()
        with Horizontal(id="upper"):
            yield self.modules
            yield self.robot
        yield self.trouble
        yield self.boards
        with Horizontal(id="lower"):
            yield self.log_view
            yield self.map
        yield self.search
        yield from self.more()
        yield Footer(compact=True, show_command_palette=True)

    def more(self) -> ComposeResult:
        """What a screen of its kind has besides."""
        yield from ()

    def on_mount(self) -> None:
        self.search.display = self.boards.display = self.trouble.display = False
        self.set_focus(self.modules)

    def show(self, snapshot: Snapshot) -> None:
        self.modules.show(snapshot)
        self.robot.show(snapshot)
        self.trouble.show(snapshot, self.modules.marked_module)
        self.boards.show(snapshot)

    def show_floor(self, picture: FloorPicture) -> None:
        if self.map.display:
            self.map.show(picture)

    def feed_log(self, entries: list[LogEntry], dropped: int) -> None:
        self.log_view.lines_dropped = dropped
        self.log_view.feed(entries)

    # The filter of the log

    @property
    def filter(self) -> LogFilter:
        return self.log_view.book.filter

    def set_filter(self, wanted: LogFilter) -> None:
        try:
            self.log_view.set_filter(wanted)
            self.log_view.show_problem("")
        except (re.error, OverflowError, RecursionError) as error:
            self.log_view.show_problem(f"no regular expression: {error}")

    def open_search(self) -> None:
        self.search.display = True
        self.set_focus(self.search)

    def cycle_level(self) -> None:
        following = LEVELS[(LEVELS.index(self.filter.level) + 1) % len(LEVELS)]
        self.set_filter(replace(self.filter, level=following))

    def cycle_module(self) -> None:
        """The marked module first, or whoever logs for it, then the ones after it, then all of them."""
        now, logging = self.filter.module, (name for name in self.modules.names if name in PACKAGES)
        wanted = publisher_of(self.modules.marked_module) if now is None else dict(pairwise(logging)).get(now)
        self.set_filter(replace(self.filter, module=wanted))

    def set_topics(self, topics: frozenset[str]) -> None:
        self.set_filter(replace(self.filter, topics=topics))

    def clear_filter(self) -> None:
        self.search.value, self.search.display = "", False
        self.set_filter(LogFilter(level=LEVELS[0], topics=self.filter.topics))

    @on(Input.Changed, "#search")
    def search_changed(self, event: Input.Changed) -> None:
        self.set_filter(replace(self.filter, pattern=event.value))

    @on(Input.Submitted, "#search")
    def search_kept(self) -> None:
        self.search.display = bool(self.search.value)
        self.log_view.focus()

    def action_to_log(self) -> None:
        if self.search.has_focus:
            self.search.value, self.search.display = "", False
        self.log_view.focus()
