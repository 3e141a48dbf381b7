"""Dialogs that request a confirmation or an input before a command is sent."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.widgets import Button, Input, SelectionList, Static

from common.messages.mission import Operation
from common.mission_state import effect, hindrance
from offboard.command_center.command_center import MESSAGE_TOPICS
from offboard.command_center.places import UnknownPlace, find_place
from offboard.command_center.screens.guarded import GuardedModal, T
from offboard.command_center.snapshot import Finding, Snapshot
from offboard.command_center.widgets.field import Field
from offboard.command_center.zone_text import FORMS, zone_order
from offboard.operate.operations import Order

RELEASE_WORD = "release"
_FINDINGS_SHOWN = 12


class ChoiceScreen(GuardedModal[T]):
    """A question with buttons: the arrow keys go from one to the next, enter presses the marked one."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("left,up", "app.focus_previous", "Previous", show=False),
        Binding("right,down", "app.focus_next", "Next", show=False),
    ]


class ConfirmScreen(ChoiceScreen[bool]):
    """What a command to drive will do, as the robot stands now, with yes and no; enter is yes."""

    def __init__(self, operation: Operation, title: str, yes: str) -> None:
        super().__init__()
        self.heading = title
        self._operation, self._yes = operation, yes
        self._effect = Static(markup=False, classes="question")
        self._why_not = Static(markup=False, classes="warning")

    def content(self) -> ComposeResult:
        yield self._effect
        with Horizontal(classes="buttons"):
            yield Button(self._yes, variant="primary", id="yes")
            yield Button("Back", id="no")
        yield self._why_not

    def on_mount(self) -> None:
        self.show(self.center.node.snapshot())
        self.set_focus(self.query_one("#yes"))

    def show(self, snapshot: Snapshot) -> None:
        """Said anew whenever the robot's state changes: a stop may be latched while the question is open."""
        self._effect.update(effect(self._operation, snapshot.view, snapshot.permit))
        self._why_not.update(hindrance(self._operation, snapshot.view, snapshot.permit))

    @on(Button.Pressed)
    def answer(self, event: Button.Pressed) -> None:
        snapshot = self.center.node.snapshot()
        if event.button.id == "no":
            self.dismiss(False)
        elif not hindrance(self._operation, snapshot.view, snapshot.permit):
            self.dismiss(True)


class ReleaseScreen(GuardedModal[bool]):
    """The release of the stop takes a typed word, and messages from a robot whose button is out."""

    heading = "Release the software stop"

    def __init__(self, hindrance: Callable[[], str]) -> None:
        super().__init__()
        self._hindrance = hindrance
        self._wrong_word = ""
        self._why_not = Static(markup=False, classes="warning")
        self._word = Field(placeholder=RELEASE_WORD, id="word")

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
        self.set_focus(self._word)

    def show(self, snapshot: Snapshot) -> None:
        self._why_not.update(self._hindrance() or self._wrong_word)

    @on(Input.Changed)
    def typed(self) -> None:
        self._wrong_word = ""

    @on(Input.Submitted)
    def answer(self, event: Input.Submitted) -> None:
        right = event.value.strip().lower() == RELEASE_WORD
        self._wrong_word = "" if right else f"Nothing was released: the word is {RELEASE_WORD}."
        refusal = self._hindrance() or self._wrong_word
        self._why_not.update(refusal)
        if not refusal:
            self.dismiss(True)


class GotoScreen(GuardedModal[tuple[float, float]]):
    """Where to: the number of a door that was found, or metres."""

    heading = "Drive to"

    def __init__(self, findings: tuple[Finding, ...]) -> None:
        super().__init__()
        self._findings = findings
        self._effect = Static(markup=False, classes="question")
        self._why_not = Static(markup=False, classes="warning")
        self._place = Field(placeholder="door number, or X,Y in metres", id="place")

    def content(self) -> ComposeResult:
        yield self._effect
        yield self._place
        yield self._why_not

    def on_mount(self) -> None:
        self.show(self.center.node.snapshot())
        self.set_focus(self._place)

    def show(self, snapshot: Snapshot) -> None:
        does = effect(Operation.GOTO, snapshot.view, snapshot.permit)
        self._effect.update(f"{self._known()}\n{does}")

    def _known(self) -> str:
        numbers = sorted(finding.number for finding in self._findings if finding.number)
        more = f" and {len(numbers) - _FINDINGS_SHOWN} more" if len(numbers) > _FINDINGS_SHOWN else ""
        return f"Doors: {', '.join(numbers[:_FINDINGS_SHOWN])}{more}" if numbers else "No door number was read yet."

    @on(Input.Submitted)
    def answer(self, event: Input.Submitted) -> None:
        try:
            self.dismiss(find_place(event.value, self._findings))
        except UnknownPlace as error:
            self._why_not.update(str(error))


class ZoneScreen(GuardedModal[Order]):
    """A no-go line or area, or an area to stay in, by its corners; or the number of one to be removed."""

    heading = "No-go lines and areas"

    def __init__(self) -> None:
        super().__init__()
        self._known = Static(markup=False, classes="question")
        self._why_not = Static(markup=False, classes="warning")
        self._zone = Field(placeholder="line 3,-1 3,1", id="zone")

    def content(self) -> ComposeResult:
        yield self._known
        yield self._zone
        yield self._why_not

    def on_mount(self) -> None:
        self.show(self.center.node.snapshot())
        self.set_focus(self._zone)

    def show(self, snapshot: Snapshot) -> None:
        there = "; ".join(zone.title for zone in snapshot.zones) or "none"
        self._known.update(f"There: {there}.\nWrite {FORMS}; metres on the map.")

    @on(Input.Submitted)
    def answer(self, event: Input.Submitted) -> None:
        try:
            self.dismiss(zone_order(event.value.split()))
        except UnknownPlace as error:
            self._why_not.update(str(error))


class LeaveScreen(ChoiceScreen[str]):
    """Leaving `local`: with the mesh or without it. Enter alone changes nothing."""

    heading = "Leave the Command Center"
    CHOICES: ClassVar[dict[str, str]] = {"stay": "Stay", "keep": "Leave it running", "end": "End everything"}

    def content(self) -> ComposeResult:
        yield Static(
            "Shall the robot's mesh end too? What was mapped so far is written to the run folder.",
            markup=False,
            classes="question",
        )
        with Horizontal(classes="buttons"):
            for choice, label in self.CHOICES.items():
                yield Button(label, id=choice, variant="error" if choice == "end" else "default")

    def on_mount(self) -> None:
        self.set_focus(self.query_one("#stay"))

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
