"""One row per module: state, error and what to do, memory, rate, age."""

from __future__ import annotations

from rich.text import Text
from textual.widgets import DataTable

from common.modules import MODULES, SPECIFIED
from offboard.command_center.module_health import health_text
from offboard.command_center.module_watch import Freshness, ModuleRow
from offboard.command_center.snapshot import Snapshot
from offboard.command_center.widgets.titles import title

# Key, heading and width; the last one is cut off by the edge of the table
COLUMNS = (
    ("module", "module", 14),
    ("code", "", 3),
    ("state", "state", 10),
    ("age", "age", 12),
    ("memory", "memory", 7),
    ("cpu", "cpu", 5),
    ("rate", "rate", 5),
    ("error", "error → what to do", 100),
)
_CODES = {module.name: module.code for module in SPECIFIED}
_DIM, _BAD, _GOOD = "#6e7681", "bold #ff7b72", "#7ee787"
_UNIT = 1024


def age_text(age_s: float) -> str:
    """The age in the largest unit that fits, to save width."""
    if age_s < 60:
        return f"{age_s:.1f} s"
    return f"{age_s / 60:.0f} min" if age_s < 3600 else f"{age_s / 3600:.0f} h"


def memory_text(memory_kb: int) -> str:
    return f"{memory_kb} kB" if memory_kb < 10 * _UNIT else f"{memory_kb / _UNIT:.0f} MB"


def cells(row: ModuleRow) -> tuple[Text, ...]:
    """What the row shows, in the order of COLUMNS. An old value is dimmed and marked as old."""
    status, fresh = row.status, row.freshness
    old = _DIM if fresh is not Freshness.LIVE else ""
    name = Text(row.module.replace("_", " "), style=old or "bold")
    code = Text(_CODES.get(row.module, ""), style=_DIM)
    if status is None:
        return name, code, Text("–", _DIM), Text("no message", _DIM), *(Text("–", _DIM) for _ in range(3)), Text("")
    state = Text(status.state, style=old or ("" if status.ready else "#e3b341"))
    memory = Text(memory_text(status.memory_kb), style=old, justify="right")
    used = f"{100 * status.cpu_share:.0f} %" if status.cpu_share else "–"
    cpu = Text(used, style=old, justify="right")
    rate = Text(f"{row.rate_hz:.0f} Hz", style=old, justify="right")
    if fresh is Freshness.LIVE:
        age = Text("● live", style=_GOOD)
    else:
        age = Text(f"{fresh.value} {age_text(row.age_s)}", style=_BAD)
    return name, code, state, age, memory, cpu, rate, _error(row, old)


def _error(row: ModuleRow, old: str) -> Text:
    assert row.status is not None
    if not row.status.error_code:
        return Text(row.status.detail or "ok", style=_DIM)
    meaning, action = row.error
    text = Text(f"{row.status.error_code} ", style=old or _BAD)
    text.append(meaning, style=old or "#ffa198")
    text.append(f" → {action}", style=old or "#e3b341")
    return text


class ModuleTable(DataTable[Text]):
    """Rewrites only the cells that changed."""

    def __init__(self) -> None:
        super().__init__(id="modules", cursor_type="row", zebra_stripes=False, cell_padding=1)
        self._shown: dict[str, tuple[Text, ...]] = {}  # by module, in the order of the rows

    def on_mount(self) -> None:
        for key, heading, width in COLUMNS:
            self.add_column(heading, key=key, width=width)
        for module in MODULES:
            if not module.optional:
                self._add(module.name)

    def _add(self, module: str) -> None:
        self._shown[module] = tuple(Text("") for _ in COLUMNS)
        self.add_row(*self._shown[module], key=module)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the modules, in the order of their rows."""
        return tuple(self._shown)

    @property
    def marked_module(self) -> str:
        return self.names[self.cursor_row]

    def show(self, snapshot: Snapshot) -> None:
        for row in snapshot.rows:
            new = cells(row)
            if row.module not in self._shown:
                self._add(row.module)
            old = self._shown[row.module]
            for i, (key, _, _) in enumerate(COLUMNS):
                if old[i] != new[i] or old[i].style != new[i].style:
                    self.update_cell(row.module, key, new[i])
            self._shown[row.module] = new
        live = sum(row.freshness is Freshness.LIVE for row in snapshot.rows)
        self.border_title = title(f"MODULES {live}/{len(snapshot.rows)} live")
        if snapshot.rows:
            marked = snapshot.rows[self.cursor_row]
            text = health_text(marked.samples)
            self.border_subtitle = title(f"{marked.module.replace('_', ' ')}: {text}" if text else "")
