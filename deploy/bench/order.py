"""What the verb `bench` orders of a benchmark."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

PAIRS, PAIRS_QUICK = 5, 1


@dataclass(frozen=True, slots=True)
class Order:
    quick: bool = False
    against: Path | None = None  # another checkout, to be measured by turns with this one
    pairs: int = PAIRS
    floors: Path | None = None  # a folder of floor files, in place of the project's own
