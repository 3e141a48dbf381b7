"""The log: only what is visible is drawn, so that its length costs nothing. Scrolling up pauses, collecting goes on."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterable
from datetime import datetime
from math import inf
from typing import ClassVar

from rich.segment import Segment
from rich.style import Style
from textual.binding import Binding, BindingType
from textual.geometry import Size
from textual.scroll_view import ScrollView
from textual.strip import Strip

from offboard.command_center.log_book import MESSAGE_LEVEL, LogBook, LogEntry, LogFilter
from offboard.command_center.widgets.titles import title

_LEVEL_STYLES = {
    "DEBUG": Style(color="#6e7681"),
    "INFO": Style(color="#58a6ff"),
    "WARNING": Style(color="#e3b341", bold=True),
    "ERROR": Style(color="#ff7b72", bold=True),
    "CRITICAL": Style(color="#ffffff", bgcolor="#b62324", bold=True),
    MESSAGE_LEVEL: Style(color="#a371f7"),
}
_LEVEL_NAMES = {"WARNING": "WARN", "CRITICAL": "CRIT", MESSAGE_LEVEL: "MSG"}
_TIME, _TEXT, _MESSAGE = Style(color="#6e7681"), Style(color="#c9d1d9"), Style(color="#8b949e")
_COUNT, _MARKED = Style(color="#16181d", bgcolor="#e3b341", bold=True), Style(bgcolor="#1f3a5f")
_LATER = Style(dim=True)
_MODULE_WIDTH = len("command_center")
_LEAD = len("00:00:00 ERROR ") + _MODULE_WIDTH + 12


class LogView(ScrollView, can_focus=True):
    """Shows a `LogBook`. `following` is true while the newest line is kept in sight.

    `wall_offset_s`: from the clock of the lines' arrival to wall time. Of a recorded run all lines are there at any
    moment: those that came later are dim, and the newest before it is what is followed.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "mark(-1)", "Line up", show=False),
        Binding("down", "mark(1)", "Line down", show=False),
        Binding("end", "newest", "Newest", show=False),
    ]

    def __init__(self, book: LogBook, wall_offset_s: float) -> None:
        super().__init__(id="log")
        self.book = book
        self._until_s = inf
        self.following = True
        self.problem = ""  # with the newest filter
        self.lines_dropped = 0
        self._marked: LogEntry | None = None
        self._unseen = 0
        self._columns = 0
        self._wall_offset_s = wall_offset_s

    def on_mount(self) -> None:
        self._retitle()

    @property
    def marked(self) -> LogEntry | None:
        return self._marked

    def feed(self, entries: Iterable[LogEntry]) -> None:
        """New entries: followed while following, else counted."""
        before = len(self.book.shown)
        entries = list(entries)
        fallen = self.book.add(entries)
        if not entries:
            return
        new = len(self.book.shown) - before + fallen
        self._columns = max([self._columns, *(_LEAD + len(e.text) for e in self.book.shown[-new:] if new)])
        self._unseen = 0 if self.following else self._unseen + new
        self._settle(fallen)

    def fill(self, entries: Iterable[LogEntry]) -> None:
        """These in place of all that there are."""
        self.book = LogBook(filter=self.book.filter)
        self._columns, self._marked = 0, None
        self.feed(entries)

    def show_until(self, until_s: float) -> None:
        """The moment that is shown, on the clock of the lines' arrival."""
        before, self._until_s = self._passed, until_s
        if self._passed != before:
            self._settle(0)

    @property
    def _passed(self) -> int:
        """How many of the shown lines had arrived."""
        return bisect_right(self.book.shown, self._until_s, key=lambda entry: entry.arrived_s)

    def set_filter(self, wanted: LogFilter) -> None:
        """Raises as `LogBook.set_filter` does."""
        self.book.set_filter(wanted)
        self._columns = max((_LEAD + len(e.text) for e in self.book.shown), default=0)
        self._settle(0)

    def follow(self, follow: bool) -> None:
        self.following = follow
        if follow:
            self._unseen = 0
        self._settle(0)

    def action_mark(self, step: int) -> None:
        shown = self.book.shown
        if not shown:
            return
        index = self._index(self._marked) if self._marked is not None else max(self._passed, 1) - 1
        index = max(0, min(len(shown) - 1, index + step))
        self._marked = shown[index]
        if step < 0:
            self.follow(False)
        if index < self.scroll_offset.y:
            self.scroll_to(y=index, animate=False, immediate=True)
        elif index >= self.scroll_offset.y + self.size.height:
            self.scroll_to(y=index - self.size.height + 1, animate=False, immediate=True)
        self.refresh()

    def action_newest(self) -> None:
        self.follow(True)

    def watch_scroll_y(self, old_value: float, new_value: float) -> None:
        super().watch_scroll_y(old_value, new_value)
        if new_value < old_value and self.following and new_value < self.max_scroll_y:
            self.following = False
            self._retitle()
        elif new_value > old_value and not self.following and new_value >= self.max_scroll_y:
            self.follow(True)

    def render_line(self, y: int) -> Strip:
        scroll_x, scroll_y = self.scroll_offset
        index = scroll_y + y
        shown = self.book.shown
        if index >= len(shown):
            return Strip.blank(self.size.width, self.rich_style)
        entry = shown[index]
        strip = Strip(self._segments(entry)).crop_extend(scroll_x, scroll_x + self.size.width, None)
        if entry.arrived_s > self._until_s:
            strip = strip.apply_style(_LATER)
        return strip.apply_style(self.rich_style + _MARKED if entry is self._marked else self.rich_style)

    def _segments(self, entry: LogEntry) -> list[Segment]:
        clock = datetime.fromtimestamp(entry.arrived_s + self._wall_offset_s)
        level = _LEVEL_NAMES.get(entry.level, entry.level)
        segments = [
            Segment(f"{clock:%H:%M:%S} ", _TIME),
            Segment(f"{level:<5} ", _LEVEL_STYLES.get(entry.level, _TEXT)),
            # SIM stands for the bridge too, CM for the recorder
            Segment(f"{entry.module:<{_MODULE_WIDTH}} ", _TIME),
            Segment(entry.text, _MESSAGE if entry.is_message else _TEXT),
        ]
        if entry.count > 1:
            segments += [Segment("  "), Segment(f" ×{entry.count} ", _COUNT)]
        return segments

    def _index(self, entry: LogEntry) -> int:
        return bisect_left(self.book.shown, entry.number, key=lambda e: e.number)

    def _settle(self, fallen: int) -> None:
        """Bring size, position and title in line with the book."""
        following = self.following
        self.virtual_size = Size(self._columns, len(self.book.shown))
        if following:
            newest_y = max(0, self.max_scroll_y - (len(self.book.shown) - self._passed))
            self.scroll_to(y=newest_y, animate=False, immediate=True, force=True)
            self.following = True
        elif fallen:
            self.scroll_to(y=max(0, self.scroll_offset.y - fallen), animate=False, immediate=True, force=True)
        # Textual does not move a scroll bar that is not shown yet
        self.vertical_scrollbar.position = self.scroll_y
        self._retitle()
        self.refresh()

    def _retitle(self) -> None:
        book = self.book
        self.border_title = title(f"LOG {len(book.shown)}/{book.total} · {book.filter.describe()}")
        notes = []
        if self.problem:
            notes.append(self.problem)
        if self.lines_dropped:
            notes.append(f"{self.lines_dropped} dropped")
        if not self.following:
            notes.append(f"PAUSED, {self._unseen} new · f follows")
        self.border_subtitle = title(" · ".join(notes))
        self.set_class(not self.following, "-paused")

    def show_problem(self, problem: str) -> None:
        self.problem = problem
        self._retitle()
