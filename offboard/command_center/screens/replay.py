"""The screens of a recorded run: the main one with its timeline, and the question for a moment."""

from __future__ import annotations

import re
from collections.abc import Callable

from textual import on
from textual.app import ComposeResult
from textual.widgets import Input, Static

from offboard.command_center.screens.guarded import GuardedModal
from offboard.command_center.screens.main import MainScreen
from offboard.command_center.widgets.field import Field
from offboard.command_center.widgets.timeline import Timeline, moment_text

_MOMENT = re.compile(r"(?:(?:(\d{1,3}):)?(\d{1,4}):)?(\d{1,6}(?:\.\d+)?)")


def moment_of(text: str) -> float | None:
    """Seconds of 192, 3:12 or 0:03:12; None for what is no time."""
    parts = _MOMENT.fullmatch(text.strip())
    if parts is None:
        return None
    hours, minutes, seconds = (float(part or 0) for part in parts.groups())
    return 3600 * hours + 60 * minutes + seconds


class ReplayScreen(MainScreen):
    """Of a run."""

    def __init__(self, page: str, wall_offset_s: float, jump: Callable[[float], None]) -> None:
        super().__init__(page, wall_offset_s)
        self.timeline = Timeline(jump)

    def more(self) -> ComposeResult:
        yield self.timeline


class MomentScreen(GuardedModal[float]):
    """To which moment: its time since the run began."""

    heading = "Go to a moment"

    def __init__(self, duration_s: float) -> None:
        super().__init__()
        self._duration_s = duration_s
        self._why_not = Static(markup=False, classes="warning")
        self._moment = Field(placeholder="3:12, or seconds", id="moment")

    def content(self) -> ComposeResult:
        yield Static(f"The run lasts {moment_text(self._duration_s)}.", markup=False, classes="question")
        yield self._moment
        yield self._why_not

    def on_mount(self) -> None:
        self.set_focus(self._moment)

    @on(Input.Submitted)
    def answer(self, event: Input.Submitted) -> None:
        at_s = moment_of(event.value)
        if at_s is None or at_s > self._duration_s:
            self._why_not.update(f"A moment is a time up to {moment_text(self._duration_s)}, for example 3:12.")
        else:
            self.dismiss(at_s)
