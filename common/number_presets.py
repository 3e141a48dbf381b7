"""The forms of room numbers that sites commonly use, by name, for `robot.toml`.

A form is a regular expression of the whole number as it stands on the plate: separators included, of the spaces only
those between two digits.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Preset:
    """A form by its regular expression; `examples` are for people, and the tests hold that they match."""

    pattern: str
    examples: tuple[str, ...]


_SUFFIX = "[A-Za-z]?"
_BUILDING = "(?:[A-Z]{1,3}[0-9]{0,2}|[0-9]{1,3})"

# In the order in which they are tried where a number fits several
PRESETS = {
    "plain": Preset("[0-9]{3,4}[A-Za-z]{0,2}", ("501", "2041", "215B", "204SC")),
    "short": Preset(f"[0-9]{{1,2}}{_SUFFIX}", ("7", "12", "12b")),
    "letter-prefix": Preset(f"[A-Z]{{1,3}}[0-9]{{1,4}}{_SUFFIX}", ("A204", "EG12", "ITB119")),
    "floor.room": Preset(rf"(?:-|[A-Z])?[0-9]{{1,2}}\.[0-9]{{1,3}}{_SUFFIX}", ("2.01", "10.5", "-1.05", "U1.03")),
    "floor/room": Preset(
        f"(?:[A-Z]{{1,2}}[0-9]{{0,2}}|-?[0-9]{{1,2}})/[0-9]{{1,3}}{_SUFFIX}", ("2/14", "-1/203", "B/12")
    ),
    "building-room": Preset(
        f"(?:{_BUILDING}-|[A-Z]{{1,3}}[0-9]{{1,2}} )[0-9]{{1,4}}{_SUFFIX}", ("16-186", "E14-633", "3-101A", "E25 143")
    ),
    "building-floor-room": Preset(f"{_BUILDING}-[0-9]{{1,2}}-[0-9]{{1,3}}{_SUFFIX}", ("A-2-14", "12-3-104")),
    "building.floor.room": Preset(
        rf"{_BUILDING}\.-?[0-9]{{1,2}}\.[0-9]{{1,3}}{_SUFFIX}", ("B.2.017", "12.0.104", "B.-1.017")
    ),
    "building|room": Preset(rf"[A-Z]{{1,2}}[0-9]{{1,2}}\|[0-9]{{1,3}}{_SUFFIX}", ("S1|07", "S1|123")),
}
DEFAULT_PRESETS = ("plain",)
OWN_PATTERN = "number_pattern"  # the name of the form that a site describes by itself
