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


def _on_main_screen(
    key: str, action: str, name: str, id_: str, *, shown: bool = True, sign: str | None = None
) -> tuple[Binding, ...]:
    """A key that works on the main screen while nobody types there; a letter with Shift or Caps Lock too.

    Priority, so that keys take effect in the order in which they come: the app handles them itself, one after the
    other, where else a busy widget would hold some of them up.
    """
    binding = Binding(key, action, name, show=shown, key_display=sign, priority=True, id=id_)
    return (binding, replace(binding, key=key.upper(), show=False, id=f"{id_}_shift")) if len(key) == 1 else (binding,)


OPERATION_BINDINGS = (
    *_on_main_screen("ctrl+r", "release", "Release", "release"),
    *_on_main_screen("s", "operate('start')", "Start", "start"),
    *_on_main_screen("p", "operate('pause')", "Pause", "pause"),
    *_on_main_screen("r", "operate('resume')", "Resume", "resume"),
    *_on_main_screen("h", "operate('home')", "Home", "home"),
    *_on_main_screen("g", "goto", "Go to", "goto"),
)
LOG_BINDINGS = (
    *_on_main_screen("slash", "search_log", "Search", "search", sign="/"),
    *_on_main_screen("l", "cycle_level", "Level", "level"),
    *_on_main_screen("m", "cycle_module", "Module", "module"),
    *_on_main_screen("t", "choose_topics", "Messages", "topics"),
    *_on_main_screen("f", "follow_log", "Follow", "follow"),
    *_on_main_screen("x", "clear_filter", "Clear filter", "clear", shown=False),
    *_on_main_screen("c", "copy_line", "Copy line", "copy", shown=False),
    *_on_main_screen("e", "export_log", "Export", "export", shown=False),
)
GENERAL_BINDINGS = (
    *_on_main_screen("question_mark", "help", "Help", "help", sign="?"),
    *_on_main_screen("q", "leave", "Leave", "leave"),
)
MAIN_SCREEN_ACTIONS = frozenset(
    binding.action.partition("(")[0] for binding in (*OPERATION_BINDINGS, *LOG_BINDINGS, *GENERAL_BINDINGS)
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
