"""Which key does what. The actions are in `actions.py`; the help screen and the palette read these tables too."""

from __future__ import annotations

from textual.binding import Binding

STOP_KEYS = "ctrl+e · F12 · space"

# Priority: they work on every screen, over every modal and while somebody types
STOP_BINDINGS = (
    Binding("ctrl+e", "software_stop", "Software stop", priority=True, id="stop"),
    Binding("f12", "software_stop", "Software stop", show=False, priority=True, id="stop_f12"),
    # Only where it does not write into a field: App.check_action lets it pass there
    Binding("space", "software_stop_by_space", "Software stop", show=False, priority=True, id="stop_space"),
)
OPERATION_BINDINGS = (
    Binding("ctrl+r", "release", "Release", id="release"),
    Binding("s", "operate('start')", "Start", id="start"),
    Binding("p", "operate('pause')", "Pause", id="pause"),
    Binding("r", "operate('resume')", "Resume", id="resume"),
    Binding("h", "operate('home')", "Home", id="home"),
    Binding("g", "goto", "Go to", id="goto"),
)
LOG_BINDINGS = (
    Binding("slash", "search_log", "Search", key_display="/", id="search"),
    Binding("l", "cycle_level", "Level", id="level"),
    Binding("m", "cycle_module", "Module", id="module"),
    Binding("t", "choose_topics", "Messages", id="topics"),
    Binding("f", "follow_log", "Follow", id="follow"),
    Binding("x", "clear_filter", "Clear filter", show=False, id="clear"),
    Binding("c", "copy_line", "Copy line", show=False, id="copy"),
    Binding("e", "export_log", "Export", show=False, id="export"),
)
GENERAL_BINDINGS = (
    Binding("question_mark", "help", "Help", key_display="?", id="help"),
    Binding("q", "leave", "Leave", id="leave"),
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
    "module": "Show one module only: that of the marked row, then the next, then all.",
    "topics": "Show the messages of some topics among the log lines.",
    "follow": "Pause the scrolling or follow the newest line again; nothing is lost meanwhile.",
    "clear": "Show every line again.",
    "copy": "Copy the marked line of the log (arrow keys) to the clipboard.",
    "export": "Write the filtered log to a file.",
    "help": "This page.",
    "leave": "Close the Command Center.",
}
