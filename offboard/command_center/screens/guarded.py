"""What every screen has in common: the stop bar on top."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, TypeVar, cast

from textual.app import ComposeResult
from textual.binding import BindingType
from textual.command import CommandPalette
from textual.containers import Vertical
from textual.screen import ModalScreen, Screen

from offboard.command_center.snapshot import Snapshot
from offboard.command_center.widgets.stop_bar import StopBar
from offboard.command_center.widgets.titles import title

if TYPE_CHECKING:
    from typing import Any

    from offboard.command_center.app import CommandCenterApp

    AnyScreen = Screen[Any]
else:
    AnyScreen = object

T = TypeVar("T")


class Guarded(AnyScreen):
    """Mixed into every screen: Textual has no widget that stands above all of them."""

    stop_bar: StopBar

    @property
    def center(self) -> CommandCenterApp:
        return cast("CommandCenterApp", self.app)

    def make_bar(self) -> StopBar:
        self.stop_bar = self.center.make_bar()
        return self.stop_bar

    def on_mount(self) -> None:
        # Textual calls this one and that of the screen itself
        self.center.pull_bar()

    def show(self, snapshot: Snapshot) -> None:
        """A new picture; the bar is brought up to date by the app."""


class GuardedModal(Guarded, ModalScreen[T]):
    """A question over the main screen. Esc answers no."""

    BINDINGS: ClassVar[list[BindingType]] = [("escape", "dismiss(None)", "Back")]
    heading = ""

    def compose(self) -> ComposeResult:
        yield self.make_bar()
        with Vertical(classes="box") as box:
            box.border_title = title(self.heading)
            yield from self.content()

    def content(self) -> ComposeResult:
        yield from ()


class GuardedPalette(Guarded, CommandPalette):
    """Textual's palette of commands below the bar."""

    def compose(self) -> ComposeResult:
        yield self.make_bar()
        yield from super().compose()
