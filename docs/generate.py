"""Writes the parts of the pages that the code knows best: settings, topics, modules, error codes, verbs, exports, the
mission's table.

    .venv/bin/python docs/generate.py

A part stands between `<!-- generated: NAME -->` and `<!-- /generated: NAME -->` on any page; `PARTS` has the names. The
results are committed; `tests/architecture/test_docs.py` compares them with the code.
"""

from __future__ import annotations

import argparse
import ast
import inspect
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from common.config import Config
from common.config_file import config_text
from common.errors import ERRORS
from common.messages.health import LogLine, Status
from common.messages.topics import INTERNAL_FLOWS, TOPICS, Topic
from common.mission_state import ENDED
from common.modules import MODULES
from common.number_presets import PRESETS
from common.rules import Between
from deploy.cli import build_parser
from offboard.export.formats import EXPORTS
from onboard.planner.mission.table import ALL, TABLE, Event, Mode, Row

ROOT = Path(__file__).resolve().parents[1]
PART = re.compile(r"(<!-- generated: ([\w-]+) -->\n).*?(<!-- /generated: \2 -->)", re.DOTALL)

_UNITS = {"m": "m", "deg": "degrees", "mb": "MB"}  # suffix of a setting -> its unit
_TYPES = {str: "text", int: "whole number", float: "number", bool: "true or false"}


def _table(head: str, rows: Sequence[tuple[str, ...]]) -> str:
    """A table of Markdown; `head` has the columns' titles with bars between."""
    columns = head.count("|") + 1
    lines = [f"| {head} |", "|" + "---|" * columns]
    return "\n".join([*lines, *("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows)])


def _meanings(section: type) -> dict[str, str]:
    """Key of a section of `Config` -> the text below it in the source."""
    definition = ast.parse(inspect.getsource(section)).body[0]
    assert isinstance(definition, ast.ClassDef)
    return {
        key.target.id: inspect.cleandoc(text.value.value)
        for key, text in pairwise(definition.body)
        if isinstance(key, ast.AnnAssign) and isinstance(key.target, ast.Name)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant) and isinstance(text.value.value, str)
    }


def _type(hint: Any) -> str:
    """A setting's type in words, with its limits."""
    kind, *rules = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    if get_origin(kind) is tuple:
        return f"list of {_type(get_args(kind)[0])}"
    limits = "".join(f", {rule.low:.10g} to {rule.high:.10g}" for rule in rules if isinstance(rule, Between))
    return _TYPES[kind] + limits


def _settings() -> Iterator[tuple[str, type, dict[str, str]]]:
    """Name, dataclass and meanings of every section."""
    for name, section in get_type_hints(Config).items():
        yield name, section, _meanings(section)


def _defaults() -> dict[tuple[str, str], str]:
    """(section, key) -> its default, as `robot.toml` writes it."""
    defaults, section = {}, ""
    for line in config_text(Config()).splitlines():
        if line.startswith("["):
            section = line.strip("[]")
        elif line:
            key, _, value = line.partition(" = ")
            defaults[section, key] = value
    return defaults


def settings() -> str:
    """Every key of `robot.toml`, a table for each section."""
    defaults = _defaults()
    texts = []
    for name, section, meanings in _settings():
        hints = get_type_hints(section, include_extras=True)
        rows = [
            (f"`{key}`", _type(hint), _UNITS.get(key.rsplit("_", 1)[-1], ""), f"`{defaults[name, key]}`", meanings[key])
            for key, hint in hints.items()
        ]
        docstring = section.__doc__ or ""
        lead = "" if docstring.startswith(section.__name__) else f"{inspect.cleandoc(docstring)}\n\n"
        texts.append(f"## [{name}]\n\n{lead}" + _table("key | type | unit | default | meaning", rows))
    return "\n\n".join(texts)


def sample() -> str:
    """A whole `robot.toml` with every key at its default and its meaning above it."""
    defaults = _defaults()
    lines = ["# Every setting at its default. A file needs only what differs: delete the rest.", ""]
    for name, _, meanings in _settings():
        lines.append(f"[{name}]")
        for key, meaning in meanings.items():
            lines += [f"# {meaning}", f"{key} = {defaults[name, key]}"]
        lines.append("")
    return "\n".join(lines).rstrip() + "\n"


def _key(topic: Topic[Any]) -> str:
    """Key of a topic; those that every module has count as one."""
    return f"*/{topic.key.split('/')[1]}" if topic.payload in (Status, LogLine) else topic.key


def topics() -> str:
    """The table of topics, and the specification's flows that never touch the bus."""
    rows: dict[str, tuple[str, ...]] = {}
    for topic in TOPICS:
        rate = f"{topic.rate_hz:g} Hz" if topic.rate_hz else "on event"
        flows = dict.fromkeys(flow for other in TOPICS if _key(other) == _key(topic) for flow in other.flows)
        rows[_key(topic)] = (
            f"`{_key(topic)}`",
            topic.payload.__name__,
            f"{rate}, {topic.note}" if topic.note else rate,
            topic.qos.name,
            ", ".join(topic.consumers),
            ", ".join(flows),
        )
    internal = [("(none)", "", "", "", medium, flow) for flow, medium in INTERNAL_FLOWS.items()]
    return _table("key | payload | rate | qos | consumers | flow", [*rows.values(), *internal])


def errors() -> str:
    """The table of error codes."""
    rows = [(str(code.value), f"`{code.name}`", info.meaning, info.action) for code, info in ERRORS.items()]
    return _table("code | name | meaning | what to do", rows)


def _choices(parser: argparse.ArgumentParser) -> Iterator[tuple[str, str, argparse.ArgumentParser]]:
    """Name, help and parser of every verb below a parser; the verbs of a verb come after it."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for choice in action._choices_actions:
                below = action.choices[choice.dest]
                yield choice.dest, choice.help or "", below
                for name, meaning, further in _choices(below):
                    yield f"{choice.dest} {name}", meaning, further


def _argument(action: argparse.Action) -> str:
    """An argument as a person types it."""
    named = bool(action.option_strings)
    value = str(action.metavar or (action.dest.upper() if named else action.dest))
    if isinstance(action.choices, list | tuple):
        value = "{" + ",".join(action.choices) + "}"
    if not named:
        return f"`{value}`"
    return f"`{action.option_strings[-1]}`" if action.nargs == 0 else f"`{action.option_strings[-1]} {value}`"


def verbs() -> str:
    """Every verb of the command line with its arguments."""
    texts = []
    for name, meaning, parser in _choices(build_parser()):
        rows = [
            (_argument(action), action.help or "")
            for action in parser._actions
            if not isinstance(action, argparse._HelpAction | argparse._SubParsersAction)
        ]
        text = f"## {name}\n\n{meaning[:1].upper()}{meaning[1:]}."
        texts.append(f"{text}\n\n{_table('argument | meaning', rows)}" if rows else text)
    return "\n\n".join(texts)


def mission_table() -> str:
    """Every row of the mission's table."""

    def ends(row: Row) -> str:
        if row.reaches_aim:
            return "the aim"
        return "" if row.outcome is None else row.outcome.name

    def modes(row: Row) -> str:
        return "every mode" if row.modes == ALL else " ".join(mode.name for mode in row.modes)

    rows = [
        (
            f"{row.event.name}: {row.event.value}",
            modes(row),
            f'refused: "{row.refused}"' if row.refused else row.to.name if row.to is not None else "the same",
            row.aim.name if row.aim is not None else "",
            ends(row),
        )
        for row in TABLE
    ]
    return _table("event | in mode | next mode | aim | outcome", rows)


def mission_modes() -> str:
    """What each mode is, and what each outcome means to people."""
    modes = [(mode.name, mode.value) for mode in Mode]
    outcomes = [(outcome.name, text) for outcome, text in ENDED.items()]
    return _table("mode | what people read", modes) + "\n\n" + _table("outcome in DONE | what people read", outcomes)


def mission_diagram() -> str:
    """The ways between the modes that are not open in all of them."""
    arrows: dict[tuple[str, str], list[str]] = {}
    for row in TABLE:
        if row.to is None or row.refused or row.event in (Event.GO_HOME, Event.GO_TO):
            continue
        for mode in row.modes:
            arrows.setdefault((mode.name, row.to.name), []).append(row.event.name)
    lines = [f"    {a} --> {b}: {', '.join(dict.fromkeys(events))}" for (a, b), events in arrows.items()]
    return "\n".join(["```mermaid", "stateDiagram-v2", "    [*] --> WAITING", *lines, "```"])


def exports() -> str:
    """Every format that a run can be exported in."""
    rows = [(f"`{name}`", entry.title, "yes" if entry.live else "") for name, entry in EXPORTS.items()]
    return _table("format | what | of the map of now, on the page", rows)


def modules() -> str:
    """The table of modules, each with its page."""
    rows = [
        (
            f"[{module.name}](modules/{module.name if module.package else 'firmware'}.md)",
            module.title,
            module.code,
            module.board.value,
            f"`{module.package}`" if module.package else "firmware",
        )
        for module in MODULES
    ]
    return _table("module | for people | specification | computer | package", rows)


def presets() -> str:
    rows = [(f'`"{name}"`', ", ".join(f"`{e}`" for e in p.examples), f"`{p.pattern}`") for name, p in PRESETS.items()]
    return _table("preset | numbers such as | pattern", rows)


PARTS: dict[str, Callable[[], str]] = {
    "mission-table": mission_table,
    "mission-modes": mission_modes,
    "mission-diagram": mission_diagram,
    "modules": modules,
    "settings": settings,
    "topics": topics,
    "errors": errors,
    "verbs": verbs,
    "exports": exports,
    "presets": presets,
}
FILES: dict[str, Callable[[], str]] = {"docs/robot.toml": sample}


def pages() -> list[Path]:
    """Every page of the project that may have generated parts."""
    return [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]


def expected() -> dict[Path, str]:
    """File -> its text with every generated part as the code has it now."""
    texts = {path: path.read_text(encoding="utf-8") for path in pages()}
    filled = {path: PART.sub(lambda m: f"{m[1]}{PARTS[m[2]]()}\n{m[3]}", text) for path, text in texts.items()}
    return filled | {ROOT / name: make() for name, make in FILES.items()}


def main() -> int:
    for path, text in expected().items():
        path.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
