"""Memory, threads and open files of processes and of what they started, as the kernel counts them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

_PROC = Path("/proc")


@dataclass(frozen=True, slots=True)
class Footprint:
    """`own_mb` is what belongs to no file: what of a library is shared changes with whoever else has it open."""

    resident_mb: float
    own_mb: float
    threads: int
    files: int


@dataclass(frozen=True, slots=True)
class Growth:
    """What a process needs at least in its first and in its last samples: what it takes for a moment is no growth."""

    name: str
    early: Footprint
    late: Footprint

    @property
    def own_mb(self) -> float:
        return self.late.own_mb - self.early.own_mb

    def __str__(self) -> str:
        e, g = self.early, self.late
        return (
            f"{self.name:16} resident {e.resident_mb:6.1f} -> {g.resident_mb:6.1f} MB, own {e.own_mb:6.1f} -> "
            f"{g.own_mb:6.1f} MB ({self.own_mb:+.1f}), threads {e.threads} -> {g.threads}, files {e.files} -> {g.files}"
        )


def footprint(pid: int) -> Footprint:
    """Raises OSError when the process has ended."""
    folder = _PROC / str(pid)
    kb: dict[str, int] = {}
    for line in (folder / "smaps_rollup").read_text(encoding="utf-8").splitlines()[1:]:
        name, value, *_ = line.split()
        kb[name.rstrip(":")] = int(value)
    threads = len(list((folder / "task").iterdir()))
    return Footprint(kb["Rss"] / 1024, kb["Anonymous"] / 1024, threads, len(list((folder / "fd").iterdir())))


def with_children(processes: Mapping[str, int]) -> dict[str, int]:
    """These and what they started, the latter as `name/1`, ... in the order of their ids."""
    found = dict(processes)
    children: dict[int, list[int]] = defaultdict(list)
    for folder in _PROC.iterdir():
        if folder.name.isdigit():
            try:
                parent = int((folder / "stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()[1])
            except OSError:
                continue
            children[parent].append(int(folder.name))
    for name, pid in processes.items():
        found |= {f"{name}/{k}": child for k, child in enumerate(sorted(children[pid]), 1)}
    return found


class Footprints:
    """Samples over time. A process that is not there in all of them, or that became another, is none of these."""

    def __init__(self) -> None:
        self._samples: dict[tuple[str, int], list[Footprint]] = defaultdict(list)
        self._count = 0

    def sample(self, processes: Mapping[str, int]) -> None:
        self._count += 1
        for name, pid in with_children(processes).items():
            try:
                self._samples[name, pid].append(footprint(pid))
            except OSError:
                continue

    def growths(self) -> list[Growth]:
        """Between the first and the last fifth of the samples."""
        fifth = max(1, self._count // 5)
        return [
            Growth(name, _least(samples[:fifth]), _least(samples[-fifth:]))
            for (name, _), samples in self._samples.items()
            if len(samples) == self._count
        ]


def _least(samples: list[Footprint]) -> Footprint:
    return Footprint(
        min(s.resident_mb for s in samples),
        min(s.own_mb for s in samples),
        min(s.threads for s in samples),
        min(s.files for s in samples),
    )
