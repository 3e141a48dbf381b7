"""Which key does what. The actions are in `actions.py`; the help screen and the palette read these tables too."""

from __future__ import annotations

from dataclasses import replace

from textual.binding import Binding

STOP_KEYS = "ctrl+e · F12 · space"

# Priority: they work on every screen, over every modal and while somebody types
STOP_BINDINGS = (
    Binding("ctrl+e", "software_stop", "Software stop", priority=True, id="stop"),
    Binding("f12", "software_stop", "Software stop", show=False, priority=True, id="stop_f12"),
    # Only where it does not write into a field: App.check_action lets it pass there
    Binding("space", "software_stop_by_space", "Software stop", show=False, priority=True, id="stop_space"),
)


def _key(key: str, action: str, name: str, id_: str, *, shown: bool = True, sign: str | None = None) -> list[Binding]:
    """A key of the main screen; a letter with Shift or Caps Lock too."""
    binding = Binding(key, action, name, show=shown, key_display=sign, id=id_)
    return [binding, replace(binding, key=key.upper(), show=False, id=f"{id_}_shift")] if len(key) == 1 else [binding]


OPERATION_BINDINGS = (
    *_key("ctrl+r", "release", "Release", "release"),
    *_key("s", "operate('start')", "Start", "start"),
    *_key("p", "operate('pause')", "Pause", "pause"),
    *_key("r", "operate('resume')", "Resume", "resume"),
    *_key("h", "operate('home')", "Home", "home"),
    *_key("g", "goto", "Go to", "goto"),
    *_key("z", "zone", "Zones", "zone", shown=False),
)
LOG_BINDINGS = (
    *_key("slash", "search_log", "Search", "search", sign="/"),
    *_key("l", "cycle_level", "Level", "level"),
    *_key("m", "cycle_module", "Module", "module"),
    *_key("t", "choose_topics", "Messages", "topics"),
    *_key("f", "follow_log", "Follow", "follow"),
    *_key("x", "clear_filter", "Clear filter", "clear", shown=False),
    *_key("c", "copy_line", "Copy line", "copy", shown=False),
    *_key("e", "export_log", "Export", "export", shown=False),
)
GENERAL_BINDINGS = (
    *_key("question_mark", "help", "Help", "help", sign="?"),
    *_key("q", "leave", "Leave", "leave"),
)
# The help screen's sentence about each; the keys come from the tables above
HELP: dict[str, str] = {
    "stop": "Stops the robot and latches the stop. Works everywhere, also F12, space and a click on the bar.",
    "release": "Releases the operator's stop by a typed word. Nothing moves before a resume.",
    "start": "Begins the mission: explore the floor, map it, come home.",
    "pause": "Stand until resume; no stop is latched.",
    "resume": "Go on after a pause or a released stop.",
    "home": "Give the rest of the list up and drive home.",
    "goto": "Drive to a door by its number, or to X,Y in metres.",
    "zone": "Draw or remove no-go lines and areas, and areas to explore alone.",
    "search": "Show only lines that match a regular expression.",
    "level": "Show lines from this level on.",
    "module": "Show one module only: that of the marked row, then the next, then all. The bridge logs for sim and car.",
    "topics": "Show the messages of some topics among the log lines.",
    "follow": "Pause the scrolling or follow the newest line again; nothing is lost meanwhile.",
    "clear": "Show every line again.",
    "copy": "Copy the marked line of the log (arrow keys) to the clipboard.",
    "export": "Write the filtered log to a file.",
    "help": "This page.",
    "leave": "Close the Command Center.",
}
