"""The bar on top of every screen: the software stop, what the robot reports about it, and the link."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Horizontal
from textual.widgets import Static

from offboard.command_center.bindings import STOP_KEYS
from offboard.command_center.snapshot import Snapshot
from offboard.operate.software_stop import Demand, Look

RED_BUTTON = "use the red button on the robot"


# Nothing is latched
_FREE = {
    Look.IDLE: "No stop is latched",
    Look.RELEASED: "Released – nothing moves before a resume (r)",
    Look.UNKNOWN: "comm waits for the Arduino to report its stop – nothing moves",
}


@dataclass(frozen=True, slots=True)
class BarText:
    look: Look
    headline: str
    detail: str


def bar_text(snapshot: Snapshot) -> BarText:
    """Words and look of the bar: colours are never the only sign."""
    control, report, now_s = snapshot.control, snapshot.report, snapshot.now_s
    waiting_s = now_s - control.since_s
    look = snapshot.look
    if look is Look.LINK_LOST:
        silent_s = now_s - report.permit_s
        headline = "LINK LOST" if silent_s < float("inf") else "NO MESSAGE FROM THE ROBOT YET"
        since = f"nothing received for {silent_s:.0f} s" if silent_s < float("inf") else "waiting for the mesh"
        if control.demand is Demand.STOP:
            headline = f"{headline} · STOP NOT CONFIRMED {waiting_s:.1f} s"
        return BarText(look, headline, f"{since}; {RED_BUTTON} if it moves")
    if look is Look.SENT:
        speed = f"speed {abs(report.speed_m_s):.2f} m/s" if report.wheels_known(now_s) else "wheel speed unknown"
        return BarText(look, f"SENT – NOT CONFIRMED {waiting_s:.1f} s", f"{speed}; {RED_BUTTON} if it does not stop")
    if look is Look.LATCHED:
        return _latched(snapshot)
    wheels = "standing" if report.standing else f"driving {abs(report.speed_m_s):.2f} m/s"
    return BarText(look, _FREE[look], wheels if report.wheels_known(now_s) else "wheel speed unknown")


def _latched(snapshot: Snapshot) -> BarText:
    control, report = snapshot.control, snapshot.report
    held_by = f"held by {', '.join(report.permit.stop_sources)}"
    if control.demand is Demand.RELEASE:
        return BarText(Look.LATCHED, "LATCHED – release sent, not confirmed", held_by)
    if not report.wheels_known(snapshot.now_s):
        return BarText(Look.LATCHED, "LATCHED – wheel speed unknown", f"{held_by}; {RED_BUTTON} if it moves")
    speed = f"speed {abs(report.speed_m_s):.2f}"
    if not report.standing:
        return BarText(Look.LATCHED, f"LATCHED – wheels turn, {speed}", f"{held_by}; {RED_BUTTON}")
    if control.latency_s is not None:
        headline = f"LATCHED – robot confirmed in {1000 * control.latency_s:.0f} ms, {speed}"
    else:
        headline = f"LATCHED – {speed}"
    if control.release_failed:
        return BarText(Look.LATCHED, headline, f"{held_by}; the release was NOT confirmed")
    remedy = "let the button out, then ctrl+r releases it" if report.button_pressed else "ctrl+r releases it"
    return BarText(Look.LATCHED, headline, f"{held_by}; {remedy}")


class StopBar(Horizontal):
    """Docked on top. A click anywhere on it stops the robot; it never releases anything."""

    # Here and not in the app's style sheet: the command palette takes no styles of the app
    DEFAULT_CSS = """
    StopBar {
        dock: top;
        height: 3;
        background: #232a33;
        color: #c9d1d9;
        #stop-label { width: 25; height: 3; background: #38171b; color: #ff7b72; text-style: bold;
                      content-align: center middle; text-align: center; }
        #stop-text { width: 1fr; height: 3; padding: 0 2; content-align: left middle; }
        #stop-link { width: auto; height: 3; padding: 0 2; content-align: right middle; text-align: right; }
        &:hover #stop-label { background: #6e1f26; color: #ffffff; }
        &.-sent { background: #d29922; color: #16181d; }
        &.-latched { background: #b62324; color: #ffffff; }
        &.-link_lost { background: #5a0f12; color: #ffd7d5; }
        &.-latched #stop-label { background: #8e1519; color: #ffffff; }
        &.-sent #stop-label { background: #9e6a03; color: #ffffff; }
        &.-link_lost #stop-label { background: #3a080a; color: #ffd7d5; }
    }
    """

    LABEL = f"■ SOFTWARE STOP\n{STOP_KEYS}"

    def __init__(self, press: Callable[[], None]) -> None:
        super().__init__()
        self._press = press
        self._shown: tuple[BarText, str] | None = None
        self._text = Static(id="stop-text", markup=False)
        self._link = Static(id="stop-link", markup=False)

    def compose(self) -> ComposeResult:
        yield Static(self.LABEL, id="stop-label", markup=False)
        yield self._text
        yield self._link

    def on_click(self) -> None:
        self._press()

    def words(self, snapshot: Snapshot, corner: str) -> tuple[BarText, str]:
        """What it shows, and what stands in its right corner: the robot's name, and the link to it."""
        text = bar_text(snapshot)
        return text, f"{corner}\n{'● link live' if text.look is not Look.LINK_LOST else '○ no link'}"

    def show(self, snapshot: Snapshot, corner: str) -> None:
        text, link = self.words(snapshot, corner)
        if (text, link) == self._shown:
            return
        old, self._shown = self._shown, (text, link)
        if old is None or old[0].look is not text.look:
            for look in Look:
                self.set_class(look is text.look, f"-{look.name.lower()}")
        self._text.update(Text.assemble((text.headline, "bold"), "\n", text.detail))
        self._link.update(link)
