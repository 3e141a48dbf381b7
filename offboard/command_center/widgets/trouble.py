"""What is wrong with a module and what to do, in full: its cell in the table may be too narrow for the words."""

from __future__ import annotations

from textual.widgets import Static

from offboard.command_center.module_watch import ModuleRow
from offboard.command_center.snapshot import Snapshot


def explanation(row: ModuleRow) -> str:
    """What a person should know about the module; empty where all is well."""
    if row.status is None or not row.status.error_code:
        return ""
    meaning, action = row.error
    return f"{row.module}: {row.status.error_code} {meaning} → {action}"


def trouble_text(rows: tuple[ModuleRow, ...], marked: str) -> str:
    """Of the marked module, else of the first that reports an error, and how many others do; else empty."""
    texts = {row.module: text for row in rows if (text := explanation(row))}
    if not texts:
        return ""
    text = texts.get(marked) or next(iter(texts.values()))
    return text if len(texts) == 1 else f"{text} ({len(texts) - 1} more in the table)"


class Trouble(Static):
    """Takes no room where all is well."""

    def __init__(self) -> None:
        super().__init__(id="trouble", markup=False)
        self._shown = ""

    def show(self, snapshot: Snapshot, marked: str) -> None:
        text = trouble_text(snapshot.rows, marked)
        if text != self._shown:
            self._shown = text
            self.update(text)
        self.display = bool(text)
