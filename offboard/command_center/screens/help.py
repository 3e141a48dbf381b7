"""The help: every key, what the colours mean, what the software stop is and is not."""

from __future__ import annotations

from typing import ClassVar

from rich.table import Table
from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.widgets import Static

from offboard.command_center import bindings
from offboard.command_center.screens.guarded import GuardedModal

_AGES = """\
What is older than a second is STALE, what is older than five seconds GONE: it is shown dimmed, with its age. Ages \
count from the arrival on this machine."""


def keys_table(groups: bindings.Groups) -> Table:
    """Key, name and meaning of every binding that has a meaning of its own."""
    table = Table.grid(padding=(0, 2))
    for group in groups:
        for binding in group:
            if binding.id in bindings.HELP:
                key = Text(_key(binding), style="bold #58a6ff")
                table.add_row(key, Text(binding.description, style="bold"), Text(bindings.HELP[binding.id]))
        table.add_row("", "", "")
    table.add_row(Text("ctrl+p", style="bold #58a6ff"), Text("Commands", style="bold"), "Every command by its name.")
    return table


def _key(binding: Binding) -> str:
    return bindings.STOP_KEYS if binding.id == "stop" else binding.key_display or binding.key


class HelpScreen(GuardedModal[None]):
    """Esc closes it."""

    heading = "Help"
    BINDINGS: ClassVar[list[BindingType]] = [("question_mark", "dismiss(None)", "Back")]

    def content(self) -> ComposeResult:
        with VerticalScroll(id="help"):
            yield Static(self.center.HELP_ON_SAFETY, markup=False, classes="question")
            yield Static(keys_table(self.center.BINDING_GROUPS), markup=False)
            yield Static(_AGES, markup=False, classes="question")
