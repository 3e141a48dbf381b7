"""Which key does what. The actions are in `actions.py`; the help screen and the palette read these tables too."""

from __future__ import annotations

from dataclasses import replace

from textual.binding import Binding

STOP_KEYS = "ctrl+e · F12 · space"
STOP_HELP = """\
The software stop is no emergency stop. It needs the link and the robot's own programs; the red button on the robot \
needs neither. Stand so that you can reach that button.
The bar is neutral while no stop is latched, amber while a stop is sent but not confirmed, red once the robot reports \
that it holds the stop and its wheels stand still, dark red while no message from the robot arrives."""
REPLAY_HELP = """\
This is a recorded run: no robot is connected, and no key stops or moves one. Every word is as it was shown at that \
moment. The log holds the whole run; lines that came later than the moment are dim."""

Groups = tuple[tuple[Binding, ...], ...]

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
# In place of those of stop and mission, where a recorded run is shown
REPLAY_BINDINGS = (
    *_key("space", "play", "Play or pause", "play"),
    *_key("plus", "change_speed(1)", "Faster", "faster", sign="+"),
    *_key("minus", "change_speed(-1)", "Slower", "slower", sign="-"),
    *_key("less_than_sign", "jump_by(-10)", "10 s back", "back", sign="<"),
    *_key("greater_than_sign", "jump_by(10)", "10 s ahead", "ahead", sign=">"),
    *_key("b", "jump_beside(-1)", "Moment before", "before"),
    *_key("n", "jump_beside(1)", "Next moment", "next"),
    *_key("g", "go_to_moment", "Go to", "moment"),
    *_key("enter", "jump_to_line", "To the line", "line"),
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
    "zone": "Draw or remove no-go lines and areas, and areas to stay in.",
    "search": "Show only lines that match a regular expression.",
    "level": "Show lines from this level on.",
    "module": "Show one module only: that of the marked row, then the next, then all. The bridge logs for sim and car.",
    "topics": "Show the messages of some topics among the log lines.",
    "follow": "Pause the scrolling or follow the newest line again; nothing is lost meanwhile.",
    "clear": "Show every line again.",
    "copy": "Copy the marked line of the log (arrow keys) to the clipboard.",
    "export": "Write the filtered log to a file.",
    "play": "Play the run from this moment on, or stand; also a click on the bar.",
    "faster": "Play faster, up to 30 times.",
    "slower": "Play slower, down to half as fast.",
    "back": "Jump 10 s back.",
    "ahead": "Jump 10 s ahead.",
    "before": "Jump to the moment before: a change of the mission, a door, a warning or an error.",
    "next": "Jump to the next moment.",
    "moment": "Jump to a moment by its time since the run began; a click on the timeline does so too.",
    "line": "Jump to the moment of the marked line of the log (arrow keys).",
    "help": "This page.",
    "leave": "Close the Command Center.",
}
