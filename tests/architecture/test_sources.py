"""What no source file of the project may hold, and what each must."""

from __future__ import annotations

import ast
import re

import pytest

from tests.architecture.project import modules, text_files
from tests.conftest import REQUIREMENTS

MODULES = modules()
FILES = dict(text_files())

# common/process.py: a process that cannot begin says so on stderr, before there is a log
MAY_PRINT = ("deploy/", "offboard/evaluate/", "common/process.py")
# In pieces, so that this very file does not hold what it looks for
MACHINE_PATH = re.compile(r"(?<![\w.)}\]])/(?:" + "work|" + "tmp|" + "root|" + r"home/\w+)/")
PACKAGE_INDEX = re.compile(
    "|".join(["pypi" + r"\.org", "python" + "hosted", "index" + "-url", "npm" + "js", "proxy" + r"\.golang"])
)


def hits(pattern: re.Pattern[str]) -> list[str]:
    return [
        f"{path}:{number} {line.strip()[:80]}"
        for path, text in FILES.items()
        for number, line in enumerate(text.splitlines(), 1)
        if pattern.search(line)
    ]


def test_libraries_never_print() -> None:
    assert [
        f"{module.path}:{line}"
        for module in MODULES
        if not module.path.startswith(MAY_PRINT)
        for line in module.prints()
    ] == []


def test_every_module_says_its_place_in_its_docstring() -> None:
    assert [module.path for module in MODULES if module.tree.body and not ast.get_docstring(module.tree)] == []


def test_no_source_holds_a_path_of_one_machine() -> None:
    assert hits(MACHINE_PATH) == []


def test_no_source_holds_the_address_of_a_package_index() -> None:
    assert hits(PACKAGE_INDEX) == []


def takes_markup(node: ast.AST) -> bool:
    """A widget that takes words for markup, or a title that was not made by `title`."""
    if isinstance(node, ast.Call) and ast.unparse(node.func) in ("Static", "Label"):
        return "markup=False" not in ast.unparse(node)
    if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Attribute):
        framed = node.targets[0].attr in ("border_title", "border_subtitle", "tooltip")
        return framed and not ast.unparse(node.value).startswith("title(")
    return False


def test_the_command_center_takes_no_words_for_markup() -> None:
    assert [
        f"{module.path}:{getattr(node, 'lineno', 0)}"
        for module in MODULES
        if module.path.startswith("offboard/command_center/")
        for node in ast.walk(module.tree)
        if takes_markup(node)
    ] == []


def passes_on(handler: ast.ExceptHandler) -> bool:
    """It tidies up and raises again."""
    last = handler.body[-1]
    return isinstance(last, ast.Raise) and last.exc is None


def catches_all(handler: ast.ExceptHandler) -> bool:
    caught = handler.type
    return caught is None or (isinstance(caught, ast.Name) and caught.id in ("Exception", "BaseException"))


def test_only_the_process_runner_swallows_any_error() -> None:
    caught = [
        f"{module.path}:{node.lineno}"
        for module in MODULES
        for node in ast.walk(module.tree)
        if isinstance(node, ast.ExceptHandler) and catches_all(node) and not passes_on(node)
    ]
    assert [place for place in caught if not place.startswith("common/process.py")] == []


def test_tests_name_only_requirements_that_there_are() -> None:
    named = set()
    for path, text in FILES.items():
        if path.startswith("tests/") and path.endswith(".py"):
            for marker in re.findall(r"mark\.requirement\(([^)]*)\)", text):
                named |= set(re.findall(r"[\"']([^\"']+)[\"']", marker))
    assert sorted(named - set(REQUIREMENTS)) == []


@pytest.mark.parametrize("path", ["pyproject.toml", "LICENSE"])
def test_project_is_complete(path: str) -> None:
    assert path in FILES
