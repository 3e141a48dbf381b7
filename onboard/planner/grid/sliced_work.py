"""Long work in slices: a generator that yields what each piece of it has cost, and is carried on in the next step.

Costs are estimates in microseconds of a desktop's core, made from sizes and not from a clock: a run repeats to the bit.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Generic, TypeVar

T = TypeVar("T")
Work = Generator[int, None, T]

SLICE = 40_000  # an ordinary floor is searched in one slice


class Sliced(Generic[T]):
    """Work that is not complete yet. `result` is valid once `advance` has returned True."""

    result: T

    def __init__(self, work: Work[T]) -> None:
        self._work = work

    def advance(self, budget: int = SLICE) -> bool:
        """Carry on until that much was spent; True once it is done. What the work raises, this raises."""
        while budget > 0:
            try:
                budget -= next(self._work)
            except StopIteration as end:
                self.result = end.value
                return True
        return False


def at_once(work: Work[T]) -> T:
    """The result, however long it takes."""
    sliced = Sliced(work)
    while not sliced.advance():
        pass
    return sliced.result
