"""May the robot move, by what the bridge knows? Pure: stop requests, permits, the board's reports in, yes or no out.

comm owns the stop; the gate makes it act at once, and while comm is away. It holds every stop that it received until a
permit quotes it, reports it until then, and obeys only permits of the newest epoch that it or the board ever saw.
"""

from __future__ import annotations

from common.constants import PERMIT_TIMEOUT_S
from common.fields import STOPS_MAX
from common.messages.stop import Permit, StopRequest
from onboard.bridge.protocol import StopSourceFlag, Stp

BUTTON = "button"
_BUTTON_ID = 1 << 62  # above what is drawn for a press in a command center


def button_press(session: int, count: int) -> int:
    """The stop id of a press of the board's button: the `count`-th since it was restarted."""
    return _BUTTON_ID | session << 16 | count


class MotionGate:
    def __init__(self) -> None:
        self.permit_epoch = 0  # the newest received in a permit
        self.board_epoch = 0  # the newest that the board knew
        self._held: dict[int, str] = {}  # stop id -> source
        self._permit: Permit | None = None
        self._quoted_button = 0  # id of the press of the board's button that comm knows

    @property
    def epoch(self) -> int:
        """The newest stop: permits of older ones are not obeyed."""
        return max(self.permit_epoch, self.board_epoch)

    @property
    def held(self) -> dict[int, str]:
        """Stops that no permit has quoted yet: their sources by their ids."""
        return dict(self._held)

    @property
    def life(self) -> int:
        """Of the comm whose permit was received last."""
        return self._permit.life if self._permit is not None else 0

    @property
    def stop_sources(self) -> frozenset[str]:
        """Who holds the robot, of the stops that are known here."""
        latched = self._permit.stop_sources if self._permit is not None else ()
        return frozenset(self._held.values()) | frozenset(latched)

    def request(self, request: StopRequest) -> None:
        """Holds a stop at once; releases are handled by comm. Above STOPS_MAX a further stop is not kept."""
        if request.latched and request.stop_id not in self._quoted_ids() and len(self._held) < STOPS_MAX:
            self._held[request.stop_id] = request.source

    def board(self, session: int, report: Stp) -> None:
        """The board's report of the stop it knows, and of its button."""
        self.board_epoch = max(self.board_epoch, report.epoch)
        press = button_press(session, report.button_count)
        unknown = bool(report.latched & StopSourceFlag.BUTTON) and press != self._quoted_button
        released = self._permit is not None and not self._permit.stop_sources
        if unknown or (released and report.latched & StopSourceFlag.PRESSED):
            self._held[press] = BUTTON

    def may_move(self, permit: Permit | None, permit_age_s: float) -> bool:
        """Whether the newest permit, received `permit_age_s` ago, allows motion."""
        if permit is not None and permit is not self._permit:
            self._take(permit)
        if permit is None or self._held or permit.stop_epoch < self.epoch:
            return False
        return permit.granted and permit.valid and permit_age_s <= PERMIT_TIMEOUT_S

    def _take(self, permit: Permit) -> None:
        self._permit = permit
        if permit.stop_epoch < self.epoch:
            return
        self.permit_epoch = permit.stop_epoch
        for stop_id in self._quoted_ids() & self._held.keys():
            if self._held.pop(stop_id) == BUTTON:
                self._quoted_button = stop_id

    def _quoted_ids(self) -> frozenset[int]:
        known = self._permit is not None and 0 < self._permit.stop_epoch >= self.epoch
        return frozenset(self._permit.stop_ids) if self._permit is not None and known else frozenset()
