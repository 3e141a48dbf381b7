"""One line per computer of the robot: release, uptime, load, temperature, free disk, offset of its clock, age."""

from __future__ import annotations

from math import isnan

from rich.text import Text
from textual.widgets import Static

from common.plain_text import plain
from offboard.command_center.board_watch import BoardRow
from offboard.command_center.snapshot import Snapshot
from offboard.command_center.widgets.module_table import age_text
from offboard.command_center.widgets.robot_panel import WIDE_COLUMNS

CLOCK_OFF_S = 0.5  # from here on logs of two computers cannot be read side by side
HOT_C = 80.0  # boards throttle a little above
DISK_LOW_MB = 200
_LABEL, _OLD, _ODD = "#8b949e", "italic #8b949e", "bold #e3b341"
_NAME_WIDTH, _RELEASE_WIDTH = 14, 24
_DAY_S = 86_400.0


def _uptime(uptime_s: float) -> str:
    days, rest_s = divmod(uptime_s, _DAY_S)
    return f"{days:.0f} d {age_text(rest_s)}" if days else age_text(rest_s)


def board_line(row: BoardRow, *, oddities: bool = False) -> Text:
    """Columns of fixed width, so that the lines of several boards make a table; odd values are marked.

    `oddities`: nothing but those; an empty text where there are none.
    """
    state, old = row.state, _OLD if row.old else ""
    temperature = "–" if isnan(state.temperature_c) else f"{state.temperature_c:.0f} °C"
    # Label, value, width, and whether a person should look
    columns: tuple[tuple[str, str, int, bool], ...] = (
        ("release", plain(state.release, _RELEASE_WIDTH), _RELEASE_WIDTH, False),
        ("up", _uptime(state.uptime_s), 10, False),
        ("load", f"{state.load:.2f}", 5, False),
        ("heat", temperature, 6, state.temperature_c >= HOT_C),
        ("free", f"{state.disk_free_mb / 1000:.1f} GB", 8, state.disk_free_mb < DISK_LOW_MB),
        ("clock", f"{row.clock_offset_s:+.1f} s", 0, abs(row.clock_offset_s) >= CLOCK_OFF_S),
    )
    if oddities:
        columns = tuple(column for column in columns if column[-1])
        if not columns and not row.old:
            return Text()
    line = Text()
    line.append(f"{plain(state.name, _NAME_WIDTH):<{_NAME_WIDTH}}", style=old or "bold")
    for label, value, width, odd in columns:
        line.append(f" {label} ", style=_LABEL)
        line.append(f"{value:<{width}}", style=old or (_ODD if odd else ""))
    if row.old:
        line.append(f"  as of {age_text(row.age_s)} ago", style=_ODD)
    return line


class BoardLines(Static):
    """Takes no room before a computer has reported; on a narrow screen, where there is nothing to look at."""

    def __init__(self) -> None:
        super().__init__(id="boards", markup=False)
        self._shown = Text()

    def show(self, snapshot: Snapshot) -> None:
        oddities = self.app.size.width < WIDE_COLUMNS
        lines = [line for row in snapshot.boards if (line := board_line(row, oddities=oddities))]
        text = Text("\n", no_wrap=True, overflow="ellipsis").join(lines)
        if text != self._shown:
            self._shown = text
            self.update(text)
        self.display = bool(lines)
