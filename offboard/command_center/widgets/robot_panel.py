"""What the robot does and where it is. An old position is shown as the last known one, with its age."""

from __future__ import annotations

from math import degrees

from rich.table import Table
from rich.text import Text
from textual.widgets import Static

from offboard.command_center.module_watch import STALE_S
from offboard.command_center.snapshot import Snapshot
from offboard.command_center.widgets.module_table import age_text
from offboard.command_center.widgets.titles import title

_LABEL, _OLD, _VALUE, _ODD = "#8b949e", "italic #8b949e", "bold", "bold #e3b341"
_GOOD, _BAD = "bold #7ee787", "bold #ff7b72"

WIDE_COLUMNS = 100  # from here on it has a place beside the modules

Line = tuple[str, Text]  # label and value


def _line(label: str, value: str, style: str = _VALUE, note: str = "", note_style: str = _LABEL) -> Line:
    text = Text(value, style=style)
    if note:
        text.append(f"  {note}", style=note_style)
    return label, text


def mission_line(snapshot: Snapshot) -> Line:
    """What it does, in the words of `common/mission_state.py`."""
    old = snapshot.view is not None and snapshot.view_age_s > 3 * STALE_S
    note = f"as of {age_text(snapshot.view_age_s)} ago" if old else ""
    return _line("Mission", snapshot.mission.text, _OLD if old else _VALUE, note)


def motion_line(snapshot: Snapshot) -> Line:
    """May it drive, and why not?"""
    if snapshot.permit is None or not snapshot.report.linked(snapshot.now_s):
        return _line("Motion", "not received", _OLD)
    standing = snapshot.mission.standing
    if standing:
        return _line("Motion", "stands still", _BAD, standing, "#e3b341")
    return _line("Motion", "may move", _GOOD)


def map_lines(snapshot: Snapshot) -> list[Line]:
    view = snapshot.view
    if view is None:
        return [_line("Halls", "–"), _line("Mapped", "–")]
    style = _OLD if snapshot.view_age_s > 3 * STALE_S else _VALUE
    doors = len(snapshot.findings)
    found = f"{doors} doors found" if doors != 1 else "1 door found"
    return [_line("Halls", snapshot.mission.halls, style), _line("Mapped", f"{view.area_m2:.1f} m²", style, found)]


def position_line(snapshot: Snapshot) -> Line:
    """Where the robot is, or where it was last known to be."""
    pose = snapshot.pose
    if pose is None:
        return _line("Position", "not known yet", _OLD)
    place = f"x {pose.x_m:.2f}  y {pose.y_m:.2f} m  {degrees(pose.heading_rad):.0f}°"
    if snapshot.pose_age_s > STALE_S:
        return _line("Position", place, _OLD, f"LAST KNOWN, {age_text(snapshot.pose_age_s)} ago", _ODD)
    doubt = "" if pose.valid else "  NOT VALID"
    return _line("Position", place, _VALUE, f"± {100 * pose.sd_xy_m:.0f} cm{doubt}", _LABEL if pose.valid else _ODD)


def drive_lines(snapshot: Snapshot) -> list[Line]:
    carrier, report = snapshot.carrier, snapshot.report
    if carrier is None:
        return [_line("Speed", "–"), _line("Battery", "–")]
    old = snapshot.carrier_age_s > STALE_S
    style = _OLD if old else _VALUE
    note = f"{age_text(snapshot.carrier_age_s)} ago" if old else carrier.state.value.lower()
    standing = "standing" if report.standing and not old else f"{abs(carrier.speed_m_s):.2f} m/s"
    return [_line("Speed", standing, style, note), _line("Battery", f"{carrier.battery_v:.1f} V", style)]


def zone_lines(snapshot: Snapshot) -> list[Line]:
    """What a person drew, where there is anything."""
    titles = [zone.title for zone in snapshot.zones]
    return [_line("Kept out by", ", ".join(titles))] if titles else []


def page_lines(snapshot: Snapshot, page: str) -> list[Line]:
    """The address of the live map, once that reports; of a recorded run there is none."""
    there = bool(page) and any(row.module == "visualizer" and row.status is not None for row in snapshot.rows)
    return [_line("Live map", page, f"underline #58a6ff link {page}")] if there else []


def all_lines(snapshot: Snapshot, page: str) -> list[Line]:
    return [
        mission_line(snapshot),
        motion_line(snapshot),
        *map_lines(snapshot),
        *zone_lines(snapshot),
        position_line(snapshot),
        *drive_lines(snapshot),
        *page_lines(snapshot, page),
    ]


def few_lines(snapshot: Snapshot, page: str) -> list[Line]:
    """What a small screen has room for."""
    return [mission_line(snapshot), motion_line(snapshot), position_line(snapshot), *page_lines(snapshot, page)]


class RobotPanel(Static):
    """A few labelled lines; long ones are wrapped. On a narrow screen a strip of the most important ones."""

    def __init__(self, page: str) -> None:
        super().__init__(id="robot", markup=False)
        self._page = page
        self._shown: list[tuple[Line, str]] = []
        self.words = ""  # what is shown, a line each

    def on_mount(self) -> None:
        self.border_title = title("ROBOT")

    def show(self, snapshot: Snapshot) -> None:
        narrow = self.app.size.width < WIDE_COLUMNS
        lines = (few_lines if narrow else all_lines)(snapshot, self._page)
        shown = [(line, f"{line[1].style}{line[1].spans}") for line in lines]
        if shown == self._shown:
            return
        self._shown = shown
        self.words = "\n".join(f"{label} {value.plain}" for label, value in lines)
        table = Table.grid(padding=(0, 2, 0, 0))
        table.add_column(style=_LABEL, no_wrap=True)
        table.add_column(overflow="fold")
        for label, value in lines:
            table.add_row(label, value)
        self.update(table, layout=narrow)
