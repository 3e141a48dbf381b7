"""The mission's state as it changes, with a line for the log for each change that people may ask about."""

from __future__ import annotations

from onboard.planner.mission.table import CHOICES, Event, Mode, State, Step, after


class StateLog:
    """`state` and `text` now; `take` hands out the lines."""

    def __init__(self) -> None:
        self.state = State()
        self.blacklisted: tuple[str, ...] = ()  # what the newest exploration left out, each place with its reason
        self._kept_out = False  # that is how the newest order ended
        self._lines: list[str] = []
        self._logged = self.state  # as of the newest line about it

    @property
    def text(self) -> str:
        """What it is doing, or how that ended, for people."""
        if self._kept_out:
            return f"{self.state.text}, for a no-go line or area is in the way"
        count = len(self.blacklisted)
        if not count or self.state.mode is not Mode.DONE:
            return self.state.text
        return f"{self.state.text}, {count} place{'s' if count > 1 else ''} left out"

    def leave_out(self, places: tuple[str, ...]) -> None:
        """What exploration ends without, for the reasons given."""
        self.blacklisted = places
        for place in places:
            self.note(f"given up {place}")

    def note(self, line: str) -> None:
        self._lines.append(line)

    def take(self) -> list[str]:
        """The lines since the last call."""
        lines, self._lines = self._lines, []
        return lines

    def happens(self, event: Event, why: str = "") -> Step:
        """Take the step of the table."""
        before, step = self.state, after(self.state, event)
        if step.refused or (step.state == before and not step.moves):
            return step
        self.state = step.state
        self._kept_out = event is Event.KEPT_OUT or (self._kept_out and not step.moves)
        if step.state != self._logged or event in CHOICES:
            self._logged = step.state
            self.note(f"{step.state} before={before.mode.name} event={event.name} {why}".rstrip())
        return step
