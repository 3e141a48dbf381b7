"""Text from outside, made safe to show: it must not control a terminal, break a line or fill a screen. Pure."""

from __future__ import annotations

UNPRINTABLE = "\N{REPLACEMENT CHARACTER}"
CUT_OFF = "…"


def plain(text: str, length_max: int) -> str:
    """The text on one line, in printable characters, cut to `length_max` of them.

    White space becomes a blank; what Unicode calls no printable character (control characters, marks that turn the
    direction of writing, halves of a pair) becomes UNPRINTABLE.
    """
    if len(text) > length_max:
        text = text[: length_max - len(CUT_OFF)] + CUT_OFF
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else " " if c.isspace() else UNPRINTABLE for c in text)
