"""Words in the frame of a widget: Textual would take them for markup, and text from outside must not be any."""

from __future__ import annotations

from textual.content import Content

from common.plain_text import plain

LENGTH_MAX = 500  # wider than any terminal


def title(text: str) -> Content:
    """The text as it is, on one line."""
    return Content(plain(text, LENGTH_MAX))
