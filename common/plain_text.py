"""Text from outside as a terminal may show it: one line, and nothing that the terminal would obey."""

from __future__ import annotations

LINE_MAX = 1000


def one_line(text: str) -> str:
    """The text without line ends, escape characters and what else does not print, at most LINE_MAX characters."""
    shown = "".join(c if c.isprintable() else " " for c in text[: LINE_MAX + 1])
    return shown if len(shown) <= LINE_MAX else f"{shown[: LINE_MAX - 4]} ..."
