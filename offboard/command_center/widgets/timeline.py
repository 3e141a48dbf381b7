"""Where one is in a recorded run: a line with its moments, and in words the newest of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rich.text import Text
from textual import events
from textual.widgets import Static

from common.plain_text import plain
from offboard.runs.moments import Moment

_STYLES = {"mission": "bold #58a6ff", "door": "bold #a371f7", "log": "bold #e3b341"}
_PASSED, _AHEAD, _HERE = "#8b949e", "#30363d", "bold #3fb950"
_WORDS_MAX = 300


def moment_text(at_s: float) -> str:
    """0:03:12 for 192 s."""
    minutes, seconds = divmod(int(at_s), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{seconds:02}"


def column_of(at_s: float, duration_s: float, columns: int) -> int:
    return round((columns - 1) * min(max(at_s / duration_s, 0.0), 1.0)) if duration_s > 0.0 else 0


def line_text(columns: int, at_s: float, duration_s: float, moments: Sequence[Moment]) -> Text:
    """The line; of several moments in one column the last one is drawn."""
    here = column_of(at_s, duration_s, columns)
    kinds = {column_of(moment.at_s, duration_s, columns): moment.kind for moment in moments}
    text = Text(no_wrap=True, end="")
    for column in range(columns):
        if column == here:
            text.append("█", _HERE)
        elif column in kinds:
            text.append("┿", _STYLES[kinds[column]])
        else:
            text.append("━" if column < here else "─", _PASSED if column < here else _AHEAD)
    return text


def words_text(at_s: float, moments: Sequence[Moment]) -> Text:
    """The newest moment."""
    passed = [moment for moment in moments if moment.at_s <= at_s + 0.01]
    if not passed:
        return Text(f"{len(moments)} moments in the run", _PASSED)
    newest = passed[-1]
    text = Text.assemble((moment_text(newest.at_s), _PASSED), " ", (newest.kind, _STYLES[newest.kind]), " ")
    return text.append(plain(newest.text, _WORDS_MAX))


class Timeline(Static):
    """A click on its line jumps there."""

    def __init__(self, jump: Callable[[float], None]) -> None:
        super().__init__(id="timeline", markup=False)
        self._jump, self._duration_s = jump, 0.0

    def on_click(self, event: events.Click) -> None:
        columns = max(self.content_size.width, 1)
        self._jump(self._duration_s * min(event.x, columns - 1) / max(columns - 1, 1))

    def show(self, at_s: float, duration_s: float, moments: Sequence[Moment]) -> None:
        self._duration_s = duration_s
        line = line_text(max(self.content_size.width, 1), at_s, duration_s, moments)
        words = words_text(at_s, moments)
        words.no_wrap, words.overflow = True, "ellipsis"
        self.update(Text("\n").join([line, words]))
