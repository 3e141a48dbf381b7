"""What the robot does and where it is. An old position is shown as the last known one, with its age."""

from __future__ import annotations

from math import degrees

from rich.text import Text
from textual.widgets import Static

from offboard.command_center.module_watch import STALE_S
from offboard.command_center.snapshot import Snapshot
from offboard.command_center.widgets.module_table import age_text
from offboard.command_center.widgets.titles import title

_LABEL, _OLD, _VALUE = "#8b949e", "italic #8b949e", "bold"
_WIDTH = 10


def _line(label: str, value: str, style: str = _VALUE, note: str = "", note_style: str = _LABEL) -> Text:
    line = Text(f"{label:<{_WIDTH}}", style=_LABEL)
    line.append(value, style=style)
    if note:
        line.append(f"  {note}", style=note_style)
    return line


def mission_lines(snapshot: Snapshot) -> list[Text]:
    view = snapshot.view
    if view is None:
        return [_line("Mission", "–"), _line("Halls", "–"), _line("Mapped", "–")]
    old = snapshot.view_age_s > 3 * STALE_S
    style = _OLD if old else _VALUE
    doors = len(snapshot.findings)
    note = f"as of {age_text(snapshot.view_age_s)} ago" if old else view.detail
    return [
        _line("Mission", view.mode, style, note),
        _line("Halls", f"{view.halls_open} open", style),
        _line("Mapped", f"{view.area_m2:.1f} m²", style, f"{doors} doors found" if doors != 1 else "1 door found"),
    ]


def position_lines(snapshot: Snapshot) -> list[Text]:
    """Where the robot is, or where it was last known to be."""
    pose = snapshot.pose
    if pose is None:
        return [_line("Position", "not known yet", _OLD), Text("")]
    place = f"x {pose.x_m:.2f}  y {pose.y_m:.2f} m  {degrees(pose.heading_rad):.0f}°"
    if snapshot.pose_age_s > STALE_S:
        note = f"LAST KNOWN, {age_text(snapshot.pose_age_s)} ago"
        return [_line("Position", place, _OLD), Text(" " * _WIDTH + note, style="bold #e3b341")]
    doubt = "" if pose.valid else "  NOT VALID"
    return [
        _line("Position", place),
        Text(f"{'':<{_WIDTH}}± {100 * pose.sd_xy_m:.0f} cm{doubt}", style=_LABEL if pose.valid else "bold #e3b341"),
    ]


def drive_lines(snapshot: Snapshot) -> list[Text]:
    carrier, report = snapshot.carrier, snapshot.report
    if carrier is None:
        return [_line("Speed", "–"), _line("Battery", "–")]
    old = snapshot.carrier_age_s > STALE_S
    style = _OLD if old else _VALUE
    note = f"{age_text(snapshot.carrier_age_s)} ago" if old else carrier.state.value.lower()
    standing = "standing" if report.standing and not old else f"{abs(carrier.speed_m_s):.2f} m/s"
    return [_line("Speed", standing, style, note), _line("Battery", f"{carrier.battery_v:.1f} V", style)]


def permit_line(snapshot: Snapshot) -> Text:
    permit = snapshot.permit
    if permit is None or not snapshot.report.linked(snapshot.now_s):
        return _line("Permit", "not received", _OLD)
    if permit.granted:
        return _line("Permit", "granted", "bold #7ee787")
    return _line("Permit", "none", "bold #ff7b72", permit.reason, "#e3b341")


class RobotPanel(Static):
    """A few labelled lines."""

    def __init__(self, page: str) -> None:
        super().__init__(id="robot", markup=False)
        self._page = page
        self._shown: Text | None = None

    def on_mount(self) -> None:
        self.border_title = title("ROBOT")

    def show(self, snapshot: Snapshot) -> None:
        lines = [*mission_lines(snapshot), *position_lines(snapshot), *drive_lines(snapshot), permit_line(snapshot)]
        if any(row.module == "visualizer" and row.status is not None for row in snapshot.rows):
            lines.append(_line("Live map", self._page, f"underline #58a6ff link {self._page}"))
        text = Text("\n", no_wrap=True, overflow="ellipsis").join(lines)
        if text != self._shown or str(text.spans) != str(self._shown.spans if self._shown else ""):
            self._shown = text
            self.update(text)
