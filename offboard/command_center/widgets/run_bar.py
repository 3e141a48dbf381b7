"""The bar on top of every screen of a recorded run: the moment that is shown, and how stop and mission stood."""

from __future__ import annotations

from offboard.command_center.snapshot import Snapshot
from offboard.command_center.widgets.stop_bar import BarText, StopBar, bar_text
from offboard.operate.software_stop import Look

_THEN = {
    Look.IDLE: "No stop was latched",
    Look.RELEASED: "Released – it waited for a resume",
    Look.LINK_LOST: "Nothing was received from the robot",
}


class RunBar(StopBar):
    """A click on it plays the run, or lets it stand. It stops nothing: there is no robot."""

    LABEL = "RECORDED RUN\nspace plays it"
    DEFAULT_CSS = """
    RunBar #stop-label, RunBar.-latched #stop-label, RunBar.-link_lost #stop-label, RunBar:hover #stop-label {
        background: #1f3a5f; color: #ffffff;
    }
    """

    def words(self, snapshot: Snapshot, corner: str) -> tuple[BarText, str]:
        text = bar_text(snapshot)
        headline = _THEN.get(text.look, text.headline)
        detail = f"mission: {snapshot.mission.text}" if snapshot.view is not None else "no mission was recorded yet"
        return BarText(text.look, headline, detail), corner
