"""What runs on a board, as far as Python packages go: Debian release -> Python and C library -> tags of wheels."""

from __future__ import annotations

from dataclasses import dataclass

from common.config import BoardSection


@dataclass(frozen=True, slots=True)
class Debian:
    """A release: the Python that it has, and the newest minor version of glibc 2 whose wheels run there."""

    name: str
    python: str
    glibc_minor: int


DEBIAN = {12: Debian("bookworm", "3.11", 36), 13: Debian("trixie", "3.13", 41)}
# Levels of manylinux that packages are built for. pip takes wheels of the named levels only, and where none fits it
# takes an older version of the package, without a word: hence all of them
_MANYLINUX_MINORS = (5, 12, *range(17, 42))
_MANYLINUX_NAMES = {5: "manylinux1", 12: "manylinux2010", 17: "manylinux2014"}
_OLDEST_MINOR = {"x86_64": 5, "aarch64": 17, "armv7l": 17}


def python_of(board: BoardSection) -> str:
    """The Python of a board, like "3.11"."""
    return DEBIAN[board.debian].python


def wheel_platforms(board: BoardSection) -> list[str]:
    """The platform tags of wheels that run there, for pip; newest first."""
    machine = board.platform
    minors = [m for m in _MANYLINUX_MINORS if _OLDEST_MINOR[machine] <= m <= DEBIAN[board.debian].glibc_minor]
    tags = [f"manylinux_2_{minor}_{machine}" for minor in reversed(minors)]
    tags += [f"{_MANYLINUX_NAMES[minor]}_{machine}" for minor in reversed(minors) if minor in _MANYLINUX_NAMES]
    return [*tags, f"linux_{machine}"]
