"""The small map in half blocks, drawn once a second: enough to see where the robot is."""

from __future__ import annotations

from itertools import groupby

from rich.style import Style
from rich.text import Text
from textual.widgets import Static

from offboard.command_center.mini_map import EMPTY, INFERRED, PATH, TRAIL, WALL, ZONE, Raster, draw
from offboard.command_center.snapshot import FloorPicture
from offboard.command_center.widgets.titles import title

_COLOURS = {EMPTY: "#0d1117", PATH: "#1f4b6e", TRAIL: "#2f81f7", INFERRED: "#6e7681", WALL: "#e6edf3", ZONE: "#d29922"}
_STYLES = {
    (above, below): Style(color=_COLOURS[above], bgcolor=_COLOURS[below]) for above in _COLOURS for below in _COLOURS
}
_ROBOT, _OLD_ROBOT = Style(color="#0d1117", bgcolor="#3fb950", bold=True), Style(color="#0d1117", bgcolor="#8b949e")
_FINDING = Style(color="#e3b341", bold=True)


def picture_text(raster: Raster, *, live: bool) -> Text:
    """The raster as characters; an old position of the robot is grey."""
    text = Text(no_wrap=True, end="")
    for row in range(raster.rows):
        if row:
            text.append("\n")
        above, below = raster.codes[2 * row].tolist(), raster.codes[2 * row + 1].tolist()
        signs = [_sign(raster, row, column, pair, live) for column, pair in enumerate(zip(above, below, strict=True))]
        for style, run in groupby(signs, key=lambda sign: sign[1]):
            text.append("".join(character for character, _ in run), style)
    return text


def _sign(raster: Raster, row: int, column: int, pair: tuple[int, int], live: bool) -> tuple[str, Style]:
    if (row, column) == raster.robot:
        return raster.arrow, _ROBOT if live else _OLD_ROBOT
    if (row, column) in raster.findings:
        return "✱", _FINDING
    return "▀", _STYLES[pair]


class MapPanel(Static):
    """Draws the floor picture as large as the panel."""

    def __init__(self) -> None:
        super().__init__(id="map", markup=False)

    def on_mount(self) -> None:
        self.border_title = title("MAP")

    def show(self, picture: FloorPicture) -> None:
        size = self.content_size
        if not (size.width and size.height):
            return
        raster = draw(picture, size.width, size.height)
        self.update(picture_text(raster, live=picture.pose_live))
        scale = f"{len(picture.walls_m)} points · 10 columns = {10 * raster.square_m:.1f} m"
        self.border_subtitle = title(scale if picture.pose_live or picture.pose is None else f"STALE · {scale}")
