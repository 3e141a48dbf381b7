"""What the keys, the palette and the bar do. No widget knows any of it."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from textual.widgets import Input, TextArea

from common.messages.mission import Operation
from common.mission_state import hindrance
from offboard.command_center.command_center import CommandCenter
from offboard.command_center.screens.help import HelpScreen
from offboard.command_center.screens.main import MainScreen
from offboard.command_center.screens.questions import (
    ConfirmScreen,
    GotoScreen,
    LeaveScreen,
    ReleaseScreen,
    TopicsScreen,
    ZoneScreen,
)
from offboard.operate.operations import Order

if TYPE_CHECKING:
    from textual.app import App

    AppBase = App[int]
else:
    AppBase = object

END_MESH, KEEP_MESH = 0, 3  # exit codes

# A command that sets the robot in motion needs a confirmation, with this title and button; a stop never does
_QUESTIONS = {
    Operation.START: ("Start the mission", "Start"),
    Operation.RESUME: ("Resume", "Resume"),
    Operation.HOME: ("Drive home", "Drive home"),
}


class OperatorActions(AppBase):
    """Mixed into the app; `node` is the Command Center itself.

    A dialog is awaited until it is on the screen: the key that comes next belongs to it, however busy the program is.
    """

    node: CommandCenter
    main: MainScreen
    owns_mesh: bool
    export_dir: Path

    def pull_bar(self) -> None:
        raise NotImplementedError

    # The stop

    def action_software_stop(self) -> None:
        self.node.stop_desk.press()
        self.pull_bar()

    def action_software_stop_by_space(self) -> None:
        self.action_software_stop()

    def writes_into_a_field(self) -> bool:
        return isinstance(self.focused, (Input, TextArea))

    async def action_release(self) -> None:
        refusal = self.node.stop_desk.hindrance()
        if refusal:
            self.notify(refusal, title="Not released", severity="warning")
            return

        def answered(release: bool | None) -> None:
            if release:
                self.node.stop_desk.release()

        await self.push_screen(ReleaseScreen(self.node.stop_desk.hindrance), answered)

    # The mission

    async def action_operate(self, name: str) -> None:
        operation, snapshot = Operation(name), self.node.snapshot()
        refusal = hindrance(operation, snapshot.view, snapshot.permit)
        if refusal:
            self.notify(refusal, title=f"No {name}", severity="warning")
            return
        if operation not in _QUESTIONS:
            self.node.operate(operation)
            return

        def answered(yes: bool | None) -> None:
            if yes:
                self.node.operate(operation)

        await self.push_screen(ConfirmScreen(operation, *_QUESTIONS[operation]), answered)

    async def action_goto(self) -> None:
        def answered(place: tuple[float, float] | None) -> None:
            if place is not None:
                self.node.operate(Operation.GOTO, *place)

        await self.push_screen(GotoScreen(self.node.snapshot().findings), answered)

    async def action_zone(self) -> None:
        def answered(order: Order | None) -> None:
            if order is not None:
                self.node.give(order)

        await self.push_screen(ZoneScreen(), answered)

    # The log

    def action_search_log(self) -> None:
        self.main.open_search()

    def action_cycle_level(self) -> None:
        self.main.cycle_level()

    def action_cycle_module(self) -> None:
        self.main.cycle_module()

    def action_clear_filter(self) -> None:
        self.main.clear_filter()

    def action_follow_log(self) -> None:
        self.main.log_view.follow(not self.main.log_view.following)

    def show_messages(self, topics: frozenset[str]) -> None:
        """From now on messages of these topics stand in the log."""
        self.node.show_messages(topics)

    async def action_choose_topics(self) -> None:
        def answered(topics: frozenset[str] | None) -> None:
            if topics is not None:
                self.show_messages(topics)
                self.main.set_topics(topics)

        await self.push_screen(TopicsScreen(self.main.filter.topics), answered)

    def action_copy_line(self) -> None:
        entry = self.main.log_view.marked
        if entry is None:
            self.notify("Mark a line with the arrow keys first.", severity="warning")
            return
        self.copy_to_clipboard(entry.text)
        self.notify("Line copied.")

    def action_export_log(self) -> None:
        """The filtered log as a text file, one message in its universal form a line."""
        file = self.export_dir / f"log_{datetime.now():%Y-%m-%d_%H-%M-%S}.txt"
        shown = self.main.log_view.book.shown
        lines = [f"{entry.text}{f' x{entry.count}' if entry.count > 1 else ''}\n" for entry in shown]
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text("".join(lines), encoding="utf-8")
        except OSError as error:
            self.notify(f"{file} cannot be written: {error.strerror}.", severity="error")
            return
        self.notify(f"{len(lines)} lines are in {file}", title="Log exported")

    # The program

    async def action_help(self) -> None:
        await self.push_screen(HelpScreen())

    async def action_leave(self) -> None:
        if not self.owns_mesh:
            self.exit(END_MESH)
            return

        def answered(choice: str | None) -> None:
            if choice in ("end", "keep"):
                self.exit(END_MESH if choice == "end" else KEEP_MESH)

        await self.push_screen(LeaveScreen(), answered)

    async def action_quit(self) -> None:
        await self.action_leave()
