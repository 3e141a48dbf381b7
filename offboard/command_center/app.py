"""The terminal UI: pulls from the node a few times a second and shows it. It never sees the bus."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, ClassVar, cast

from textual import events
from textual.app import App, SystemCommand
from textual.binding import BindingType
from textual.command import CommandPalette
from textual.notifications import SeverityLevel
from textual.screen import Screen
from textual.theme import Theme

from offboard.command_center.actions import OperatorActions
from offboard.command_center.bindings import (
    GENERAL_BINDINGS,
    HELP,
    LOG_BINDINGS,
    OPERATION_BINDINGS,
    STOP_BINDINGS,
    STOP_HELP,
    Groups,
)
from offboard.command_center.command_center import CommandCenter
from offboard.command_center.screens.guarded import Guarded, GuardedPalette
from offboard.command_center.screens.main import MainScreen
from offboard.command_center.snapshot import Snapshot
from offboard.command_center.widgets.robot_panel import WIDE_COLUMNS
from offboard.command_center.widgets.stop_bar import StopBar
from offboard.operate.alerts import Alerts
from offboard.operate.operations import Answer
from offboard.operate.software_stop import Demand, StopControl

PULL_PERIOD_S = 0.2
BAR_PERIOD_S = 0.03  # while a demand is not confirmed: people watch the seconds
MAP_PERIOD_S = 1.0
ALERT_S = 30.0

WIDTHS: list[tuple[int, str]] | None = [(0, "-narrow"), (WIDE_COLUMNS, "-wide"), (130, "-very-wide")]
HEIGHTS: list[tuple[int, str]] | None = [(0, "-low"), (32, "-high")]
THEME = Theme(
    name="command-center",
    primary="#58a6ff",
    secondary="#8b949e",
    accent="#a371f7",
    warning="#e3b341",
    error="#ff7b72",
    success="#3fb950",
    foreground="#c9d1d9",
    background="#0d1117",
    surface="#11161d",
    panel="#161b22",
    dark=True,
    variables={"footer-key-foreground": "#58a6ff", "border-blurred": "#30363d"},
)


class CommandCenterApp(OperatorActions, App[int]):
    """`stop` ends it from outside; with `owns_mesh` a dialog on leaving offers to end the mesh too."""

    CSS_PATH = "command_center.tcss"
    TITLE = "Indoor Mapping"
    HORIZONTAL_BREAKPOINTS = WIDTHS
    VERTICAL_BREAKPOINTS = HEIGHTS
    BINDINGS: ClassVar[list[BindingType]] = [*STOP_BINDINGS, *GENERAL_BINDINGS, *OPERATION_BINDINGS, *LOG_BINDINGS]
    BINDING_GROUPS: ClassVar[Groups] = (STOP_BINDINGS, OPERATION_BINDINGS, LOG_BINDINGS, GENERAL_BINDINGS)
    HELP_ON_SAFETY: ClassVar[str] = STOP_HELP

    def __init__(
        self,
        node: CommandCenter,
        *,
        robot: str,
        page: str,
        export_dir: Path,
        owns_mesh: bool = False,
        stop: threading.Event | None = None,
    ) -> None:
        super().__init__()
        self.node = node
        self.owns_mesh = owns_mesh
        self.export_dir = export_dir
        self.main = self.make_main(page)
        self._robot = robot
        self._stop = stop or threading.Event()
        self._reported_operation = 0
        self._alerts = Alerts()
        self._control_shown = StopControl()

    def make_main(self, page: str) -> MainScreen:
        # Lines arrive by the monotonic clock, people read the wall clock
        return MainScreen(page, time.time() - time.monotonic())

    def make_bar(self) -> StopBar:
        """Of a screen; each has one of its own."""
        return StopBar(self.action_software_stop)

    @property
    def corner(self) -> str:
        """What stands in the bar's right corner."""
        return self._robot

    def notify(
        self,
        message: str,
        *,
        title: str = "",
        severity: SeverityLevel = "information",
        timeout: float | None = None,
        markup: bool = False,
    ) -> None:
        """Without markup unless the caller requests it: text from outside must not be interpreted."""
        super().notify(message, title=title, severity=severity, timeout=timeout, markup=markup)

    def on_mount(self) -> None:
        self.register_theme(THEME)
        self.theme = THEME.name
        self.push_screen(self.main)
        self.set_interval(PULL_PERIOD_S, self.pull)
        self.set_interval(BAR_PERIOD_S, self._pull_bar_while_demanding)
        self.set_interval(MAP_PERIOD_S, self._pull_map)

    async def on_event(self, event: events.Event) -> None:
        """Keys take effect in the order in which they come, but for a stop, which waits for none.

        Textual forwards a key to the focused widget, from where it rises through a queue of each widget above to where
        it is bound: under load another key, or the dialog that this one opens, would come in between.
        """
        if isinstance(event, events.Key) and not event.is_forwarded and not self.writes_into_a_field():
            for priority in (True, False):
                if await self._check_bindings(event.key, priority):
                    return
        await super().on_event(event)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        if action == "software_stop_by_space":
            return not self.writes_into_a_field()
        return True

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        """Every bound action by its name."""
        for binding in chain.from_iterable(self.BINDING_GROUPS):
            if binding.id in HELP:
                yield SystemCommand(binding.description, HELP[binding.id], partial(self.run_action, binding.action))

    def action_command_palette(self) -> None:
        if not CommandPalette.is_open(cast(App[Any], self)):
            self.push_screen(GuardedPalette(id="--command-palette"))

    def pull(self) -> None:
        """Bring everything that is seen up to date."""
        if self._stop.is_set():
            self.exit(0)
            return
        snapshot = self.node.snapshot()
        self.main.feed_log(self.node.take_log(), snapshot.lines_dropped)
        for screen in self.screen_stack:
            if isinstance(screen, Guarded) and screen.is_mounted:
                screen.stop_bar.show(snapshot, self.corner)
                screen.show(snapshot)
        self.call_for_help(snapshot)
        result = snapshot.operation
        if result is not None and result.answer is not Answer.WAITING and result.serial != self._reported_operation:
            self._reported_operation = result.serial
            self.notify(result.sentence, severity="information" if result.answer is Answer.TAKEN else "error")

    def call_for_help(self, snapshot: Snapshot) -> None:
        for text in self._alerts.news(snapshot.reasons, snapshot.now_s, known=snapshot.view is not None):
            self.bell()
            self.notify(text, timeout=ALERT_S)

    def pull_bar(self) -> None:
        """The bar of the screen in front alone: a press must be seen at once."""
        screen = self.screen
        if isinstance(screen, Guarded):
            screen.stop_bar.show(self.node.snapshot(), self.corner)

    def _pull_bar_while_demanding(self) -> None:
        """And once more when the robot has confirmed it: that is what somebody waits for."""
        control = self.node.stop_desk.control
        if control.demand is not Demand.NONE or control != self._control_shown:
            self._control_shown = control
            self.pull_bar()

    def _pull_map(self) -> None:
        self.main.show_floor(self.node.floor_picture())
