"""Dialogs that request a confirmation or an input before a command is sent."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from textual import on
from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import Horizontal
from textual.widgets import Button, Input, SelectionList, Static

from offboard.command_center.command_center import MESSAGE_TOPICS
from offboard.command_center.places import UnknownPlace, find_place
from offboard.command_center.screens.guarded import GuardedModal
from offboard.command_center.snapshot import Finding, Snapshot

RELEASE_WORD = "release"
_FINDINGS_SHOWN = 12


class ConfirmScreen(GuardedModal[bool]):
    """A question with yes and no; enter is yes."""

    def __init__(self, title: str, question: str, yes: str) -> None:
        super().__init__()
        self.heading = title
        self._question, self._yes = question, yes

    def content(self) -> ComposeResult:
        yield Static(self._question, markup=False, classes="question")
        with Horizontal(classes="buttons"):
            yield Button(self._yes, variant="primary", id="yes")
            yield Button("Back", id="no")

    @on(Button.Pressed)
    def answer(self, event: Button.Pressed) -> None:
        self.dismiss(event.button.id == "yes")


class ReleaseScreen(GuardedModal[bool]):
    """The release of the stop takes a typed word, and messages from a robot whose button is out."""

    heading = "Release the software stop"

    def __init__(self, hindrance: Callable[[], str]) -> None:
        super().__init__()
        self._hindrance = hindrance
        self._why_not = Static(markup=False, classes="warning")
        self._word = Input(placeholder=RELEASE_WORD, id="word")

    def content(self) -> ComposeResult:
        yield Static(
            f"Look at the robot. When nobody is in its way, type {RELEASE_WORD} and press enter.\n"
            "The release moves nothing; the robot waits for a resume.",
            markup=False,
            classes="question",
        )
        yield self._word
        yield self._why_not

    def on_mount(self) -> None:
        self._word.focus()

    def show(self, snapshot: Snapshot) -> None:
        self._why_not.update(self._hindrance())

    @on(Input.Submitted)
    def answer(self, event: Input.Submitted) -> None:
        hindrance = self._hindrance()
        if hindrance:
            self._why_not.update(hindrance)
        elif event.value.strip().lower() != RELEASE_WORD:
            self._why_not.update(f"Nothing was released: the word is {RELEASE_WORD}.")
        else:
            self.dismiss(True)


class GotoScreen(GuardedModal[tuple[float, float]]):
    """Where to: the number of a door that was found, or metres."""

    heading = "Drive to"

    def __init__(self, findings: tuple[Finding, ...]) -> None:
        super().__init__()
        self._findings = findings
        self._why_not = Static(markup=False, classes="warning")
        self._place = Input(placeholder="door number, or X,Y in metres", id="place")

    def content(self) -> ComposeResult:
        numbers = sorted(finding.number for finding in self._findings if finding.number)
        more = f" and {len(numbers) - _FINDINGS_SHOWN} more" if len(numbers) > _FINDINGS_SHOWN else ""
        known = f"Doors: {', '.join(numbers[:_FINDINGS_SHOWN])}{more}" if numbers else "No door number was read yet."
        yield Static(f"{known}\nEnter sets the robot in motion.", markup=False, classes="question")
        yield self._place
        yield self._why_not

    def on_mount(self) -> None:
        self._place.focus()

    @on(Input.Submitted)
    def answer(self, event: Input.Submitted) -> None:
        try:
            self.dismiss(find_place(event.value, self._findings))
        except UnknownPlace as error:
            self._why_not.update(str(error))


class LeaveScreen(GuardedModal[str]):
    """Leaving `local`: with the mesh or without it."""

    heading = "Leave the Command Center"
    CHOICES: ClassVar[dict[str, str]] = {"end": "End everything", "keep": "Leave it running", "stay": "Stay"}

    def content(self) -> ComposeResult:
        yield Static(
            "Shall the robot's mesh end too? What was mapped so far is written to the run folder.",
            markup=False,
            classes="question",
        )
        with Horizontal(classes="buttons"):
            for choice, label in self.CHOICES.items():
                yield Button(label, id=choice, variant="primary" if choice == "end" else "default")

    @on(Button.Pressed)
    def answer(self, event: Button.Pressed) -> None:
        self.dismiss(event.button.id)


class TopicsScreen(GuardedModal[frozenset[str]]):
    """Which topics' messages stand among the log lines."""

    heading = "Messages in the log"
    BINDINGS: ClassVar[list[BindingType]] = [("escape", "done", "Done")]

    def __init__(self, chosen: frozenset[str]) -> None:
        super().__init__()
        self._list = SelectionList[str](
            *((topic.key, topic.key, topic.key in chosen) for topic in MESSAGE_TOPICS), id="topics"
        )

    def content(self) -> ComposeResult:
        yield Static("Enter chooses a topic, a all, n none; Esc is done.", markup=False, classes="question")
        yield self._list

    def key_a(self) -> None:
        self._list.select_all()

    def key_n(self) -> None:
        self._list.deselect_all()

    def action_done(self) -> None:
        self.dismiss(frozenset(self._list.selected))
