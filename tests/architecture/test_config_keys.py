"""Every key of the configuration is read by some program."""

from __future__ import annotations

import ast
import dataclasses
from dataclasses import dataclass
from functools import cache

import pytest

from common.config import Config
from tests.architecture.project import modules

MODULES = modules()
SECTIONS_IN, FILE_IN = "common/config.py", "common/config_file.py"  # they check and write all keys
SECTIONS = {field.name: type(getattr(Config(), field.name)) for field in dataclasses.fields(Config)}
KEYS = [(name, field.name) for name, section in SECTIONS.items() for field in dataclasses.fields(section)]


def last_name(node: ast.expr | None) -> str:
    """`mesh` of `self.config.mesh` and of `mesh`."""
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


@dataclass(frozen=True)
class Names:
    """Of a module: type and name of its arguments, value and target of assignments, base and name of attributes."""

    arguments: list[tuple[str, str]]
    assigned: list[tuple[str, str]]
    read: set[tuple[str, str]]


@cache
def names() -> list[Names]:
    """Of every module but the configuration's own."""
    found = []
    for module in MODULES:
        nodes = list(ast.walk(module.tree)) if module.path not in (SECTIONS_IN, FILE_IN) else []
        arguments = [(last_name(n.annotation), n.arg) for n in nodes if isinstance(n, ast.arg)]
        assigned = [(last_name(n.value), last_name(t)) for n in nodes if isinstance(n, ast.Assign) for t in n.targets]
        read = {
            (last_name(n.value), n.attr) for n in nodes if isinstance(n, ast.Attribute) and isinstance(n.ctx, ast.Load)
        }
        found.append(Names(arguments, assigned, read))
    return found


def read_in(module: Names, section: str) -> set[str]:
    """Attributes of a section that a module reads: by its name, as an argument of its type, or what that is kept as."""
    bases = {section} | {name for kind, name in module.arguments if kind == SECTIONS[section].__name__}
    bases |= {target for value, target in module.assigned if value in bases}
    return {attribute for base, attribute in module.read if base in bases - {""}}


def behind(section: str) -> dict[str, set[str]]:
    """Property of a section -> the keys that it reads."""
    config, name = next(module for module in MODULES if module.path == SECTIONS_IN), SECTIONS[section].__name__
    kind = next(node for node in ast.walk(config.tree) if isinstance(node, ast.ClassDef) and node.name == name)
    return {
        function.name: {n.attr for n in ast.walk(function) if isinstance(n, ast.Attribute)}
        for function in kind.body
        if isinstance(function, ast.FunctionDef)
    }


@pytest.mark.parametrize("section", SECTIONS)
def test_every_key_of_the_configuration_is_read(section: str) -> None:
    read = {name for module in names() for name in read_in(module, section)}
    read |= {key for name, keys in behind(section).items() if name in read for key in keys}
    assert [key for name, key in KEYS if name == section and key not in read] == []
