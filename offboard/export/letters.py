"""The font of drawings: one file with the letters of most of the world's plates, for PDF and PNG alike."""

from __future__ import annotations

from functools import cache
from pathlib import Path


@cache
def font_file() -> Path:
    import font_roboto  # here: it comes with the laptop's packages, and only whoever draws needs it

    return Path(font_roboto.__file__).with_name("files") / "Roboto-Regular.ttf"
