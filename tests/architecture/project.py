"""The project's own files, for the tests of its architecture."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("common", "onboard", "offboard", "deploy")
TEXT_SUFFIXES = {".py", ".md", ".toml", ".txt", ".sh", ".json", ".json5", ".yaml", ".yml", ".service", ".html", ".js"}
TEXT_SUFFIXES |= {".css", ".h", ".hpp", ".c", ".cpp", ".ino", ".cfg", ".ini", ".mk", ""}
NOT_OURS = {".git", ".venv", "build", "node_modules", "__pycache__"}
RECORDED = "runs"  # at the top


def _imported(node: ast.AST) -> Iterator[tuple[str, int]]:
    if isinstance(node, ast.Import):
        yield from ((alias.name, node.lineno) for alias in node.names)
    elif isinstance(node, ast.ImportFrom) and node.level == 0:
        yield from ((f"{node.module}.{alias.name}", node.lineno) for alias in node.names)


@dataclass(frozen=True)
class Module:
    """A Python file of the packages."""

    path: str  # from the project's root, with slashes
    tree: ast.Module

    def imports(self) -> Iterator[tuple[str, int]]:
        """Every imported name, dotted and whole, with its line; also those inside functions."""
        for node in ast.walk(self.tree):
            yield from _imported(node)

    def imports_at_run_time(self) -> Iterator[str]:
        """Every imported name but those under `if TYPE_CHECKING`; also those inside functions."""
        typing_only = {
            inner
            for node in ast.walk(self.tree)
            if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
            for statement in node.body
            for inner in ast.walk(statement)
        }
        yield from (name for node in ast.walk(self.tree) if node not in typing_only for name, _ in _imported(node))

    def relative_imports(self) -> Iterator[int]:
        for node in ast.walk(self.tree):
            if isinstance(node, ast.ImportFrom) and node.level:
                yield node.lineno

    def prints(self) -> Iterator[int]:
        for node in ast.walk(self.tree):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print":
                yield node.lineno


def modules() -> list[Module]:
    """All Python files of the packages."""
    paths = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
    return [Module(path.relative_to(ROOT).as_posix(), ast.parse(path.read_text(encoding="utf-8"))) for path in paths]


def is_ours(parts: tuple[str, ...]) -> bool:
    """Of a path from the project's root: nothing that was installed, built or recorded."""
    return parts[0] != RECORDED and not NOT_OURS & set(parts)


def text_files() -> Iterator[tuple[str, str]]:
    """Path and text of every file that people write."""
    for path in sorted(ROOT.rglob("*")):
        parts = path.relative_to(ROOT).parts
        hidden = any(part.startswith(".") and part != ".ci" for part in parts)
        if hidden or not is_ours(parts) or path.suffix not in TEXT_SUFFIXES or not path.is_file():
            continue
        try:
            yield "/".join(parts), path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue
