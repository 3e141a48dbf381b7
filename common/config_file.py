"""`robot.toml` read and written: an unknown key or a wrong type is an error, never ignored."""

from __future__ import annotations

import dataclasses
import tomllib
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from common.config import Config
from common.errors import StartError
from common.modules import OPTIONAL, PACKAGES
from common.rules import Rule
from common.text_file import read_text

TEXT_MAX = 1000  # characters; no path is longer
LIST_MAX = 1000


class ConfigError(StartError):
    """The configuration cannot be used: one sentence with file, key and what is expected."""


_NAMES = {str: "text in quotes", int: "a whole number", float: "a number", bool: "true or false"}


def _convert(value: Any, hint: Any, where: str) -> Any:
    kind: Any = hint
    rules: list[Rule] = []
    if get_origin(hint) is Annotated:
        kind, *rules = get_args(hint)
    if get_origin(kind) is tuple:
        value = _convert_list(value, get_args(kind)[0], where)
    elif type(value) is not kind and (kind, type(value)) != (float, int):
        raise ConfigError(f"{where} must be {_NAMES[kind]}.")
    elif kind is str and (len(value) > TEXT_MAX or not value.isprintable()):
        raise ConfigError(f"{where} must be one line of at most {TEXT_MAX} characters.")
    # Before a whole number becomes a float, which has limits of its own
    for rule in rules:
        complaint = rule.complaint(value)
        if complaint:
            raise ConfigError(f"{where} {complaint}.")
    return float(value) if kind is float else value


def _convert_list(value: Any, hint: Any, where: str) -> tuple[Any, ...]:
    if not isinstance(value, list) or len(value) > LIST_MAX:
        kind = get_args(hint)[0] if get_origin(hint) is Annotated else hint
        raise ConfigError(f"{where} must be a list, each {_NAMES[kind]}, of at most {LIST_MAX}.")
    return tuple(_convert(v, hint, f"{where}[{i}]") for i, v in enumerate(value))


def _section(default: Any, table: Any, where: str) -> Any:
    """The default with what the table has: the sections of the boards are of one kind, with defaults of their own."""
    if not isinstance(table, dict):
        raise ConfigError(f"{where} must be a section, written [{where.split()[-1]}].")
    hints = get_type_hints(type(default), include_extras=True)
    for key in table:
        if key not in hints:
            raise ConfigError(f"{where}.{key} is not known; the keys there are {', '.join(hints)}.")
    values = {key: _convert(value, hints[key], f"{where}.{key}") for key, value in table.items()}
    return dataclasses.replace(default, **values)


def _check(config: Config, file: str) -> None:
    """What joins two keys."""
    for key, endpoint in (("listen", config.mesh.listen), ("robot", config.mesh.robot)):
        if endpoint and not config.mesh.keys:
            raise ConfigError(
                f"{file}: mesh.{key} needs mesh.keys, the folder that `indoor-mapping deploy keys` makes."
            )

    modules = [module for process in config.processes for module in process.split("+")]
    twice = next((module for module in modules if modules.count(module) > 1), None)
    if twice is not None:
        raise ConfigError(f"{file}: processes of the boards name {twice} twice; every module runs once.")
    missing = [module for module in PACKAGES if module not in (*modules, *OPTIONAL)]
    if missing:
        raise ConfigError(
            f"{file}: no board has {' or '.join(missing)} among its processes; every module must run somewhere."
        )


def parse_config(text: str, file: str = "robot.toml") -> Config:
    """The configuration in `text`; raises ConfigError, which names `file`."""
    try:
        tables = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{file} is no valid TOML: {error}.") from error
    hints = get_type_hints(Config)
    for name in tables:
        if name not in hints:
            raise ConfigError(f"{file}: section [{name}] is not known; the sections are {', '.join(hints)}.")
    defaults = Config()
    sections = {name: _section(getattr(defaults, name), table, f"{file}: {name}") for name, table in tables.items()}
    config = Config(**sections)
    _check(config, file)
    return config


def load_config(path: Path | None) -> Config:
    """The configuration in a file, or all defaults for None; raises ConfigError."""
    if path is None:
        return Config()
    return parse_config(read_text(path, f"The configuration {path}", ConfigError, "TOML"), str(path))


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple):
        return "[" + ", ".join(_toml(v) for v in value) + "]"
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return repr(value)


def config_text(config: Config) -> str:
    """The configuration as `robot.toml` holds it: `parse_config` reads it back to the same values."""
    lines: list[str] = []
    for section in dataclasses.fields(config):
        values = getattr(config, section.name)
        lines.append(f"[{section.name}]")
        lines.extend(f"{f.name} = {_toml(getattr(values, f.name))}" for f in dataclasses.fields(values))
        lines.append("")
    return "\n".join(lines)
