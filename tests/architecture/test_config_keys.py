"""Every key of the configuration is read by some program."""

from __future__ import annotations

import ast
import dataclasses
from collections.abc import Iterator

import pytest

from common.config import Config
from tests.architecture.project import Module, modules

MODULES = modules()
HOME = "common/config.py"  # checks and writes all keys
SECTIONS = {field.name: type(getattr(Config(), field.name)) for field in dataclasses.fields(Config)}
KEYS = [(name, field.name) for name, section in SECTIONS.items() for field in dataclasses.fields(section)]


def last_name(node: ast.expr) -> str:
    """`mesh` of `self.config.mesh` and of `mesh`."""
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def names_of(section: str, module: Module) -> set[str]:
    """What a section goes by in a module: its own name, arguments of its type, and what these are kept as."""
    names, kind = {section}, SECTIONS[section].__name__
    for node in ast.walk(module.tree):
        if isinstance(node, ast.arg) and node.annotation is not None and last_name(node.annotation) == kind:
            names.add(node.arg)
    for node in ast.walk(module.tree):
        if isinstance(node, ast.Assign) and last_name(node.value) in names:
            names |= {last_name(target) for target in node.targets}
    return names - {""}


def read_in(module: Module, section: str) -> Iterator[str]:
    """Attributes of a section that a module reads."""
    names = names_of(section, module)
    for node in ast.walk(module.tree):
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load) and last_name(node.value) in names:
            yield node.attr


def behind(section: str) -> dict[str, set[str]]:
    """Property of a section -> the keys that it reads."""
    config = next(module for module in modules() if module.path == "common/config.py")
    kind = next(
        n for n in ast.walk(config.tree) if isinstance(n, ast.ClassDef) and n.name == SECTIONS[section].__name__
    )
    return {
        function.name: {n.attr for n in ast.walk(function) if isinstance(n, ast.Attribute)}
        for function in kind.body
        if isinstance(function, ast.FunctionDef)
    }


@pytest.mark.parametrize("section", SECTIONS)
def test_every_key_of_the_configuration_is_read(section: str) -> None:
    read = {name for module in MODULES if module.path != HOME for name in read_in(module, section)}
    read |= {key for name, keys in behind(section).items() if name in read for key in keys}
    assert [key for name, key in KEYS if name == section and key not in read] == []
