"""A choice or a path of the mission that waits for the answers to its queries."""

from __future__ import annotations

from typing import Any

from onboard.planner.grid.deliberation import Deliberation, Query


class Pending:
    """At most one deliberation, and the query that it waits for."""

    def __init__(self) -> None:
        self._work: Deliberation[None] | None = None
        self._query: Query | None = None
        self._taken = False

    @property
    def open(self) -> bool:
        """Something waits for an answer; it needs the grid that it began with."""
        return self._work is not None

    def begin(self, work: Deliberation[None]) -> None:
        """In place of what has waited so far; it runs up to its first query, or to its end."""
        self._work = work
        self._go_on(None)

    def take(self) -> Query | None:
        """What must be known to go on, once."""
        query = None if self._taken else self._query
        self._taken = True
        return query

    def receive(self, query: Query, answer: Any) -> None:
        """The answer to a query that was taken; one that nobody waits for any more is dropped."""
        if query is self._query:
            self._go_on(answer)

    def abandon(self) -> None:
        """There will be no answer, or none is wanted any more."""
        self._work = self._query = None

    def _go_on(self, answer: Any) -> None:
        work = self._work
        assert work is not None
        try:
            self._query, self._taken = work.send(answer), False
        except StopIteration:
            if self._work is work:
                self.abandon()
