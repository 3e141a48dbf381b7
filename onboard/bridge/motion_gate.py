"""May the robot move, as far as the bridge sees? Pure: stop requests, permit and the board's button in, yes or no out.

The bridge keeps its own set of stop sources, so that a stop works at once and also while comm is away; the set of the
permit counts as well.
"""

from __future__ import annotations

from common.constants import PERMIT_TIMEOUT_S
from common.messages import Permit, StopRequest
from onboard.bridge.protocol import StopSourceFlag

BUTTON = "button"


class MotionGate:
    def __init__(self) -> None:
        self._sources: set[str] = set()
        self._permit_sources: tuple[str, ...] = ()
        self._releasing_button = False

    @property
    def stop_sources(self) -> frozenset[str]:
        return frozenset(self._sources) | frozenset(self._permit_sources)

    def request(self, request: StopRequest) -> None:
        """Any request stops; only one that its sender stands behind releases."""
        if request.latched:
            self._sources.add(request.source)
        elif request.valid:
            self._sources.discard(request.source)
            if BUTTON in self._sources:
                self._sources.discard(BUTTON)
                self._releasing_button = True

    def board_latched(self, stop_sources: int) -> None:
        """The Carrier's report: its button holds until an operator releases."""
        if not stop_sources & StopSourceFlag.BUTTON:
            self._releasing_button = False
        elif not self._releasing_button:
            self._sources.add(BUTTON)

    def release_refused(self) -> None:
        """The button is still pressed."""
        self._releasing_button = False

    def may_move(self, permit: Permit | None, permit_age_s: float) -> bool:
        """With the newest permit and how long ago it came."""
        self._permit_sources = permit.stop_sources if permit is not None else ()
        granted = permit is not None and permit.granted and permit.valid and permit_age_s <= PERMIT_TIMEOUT_S
        return granted and not self.stop_sources
