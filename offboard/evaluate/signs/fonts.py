"""The fonts that rendered signs are set in: files of Python packages, found without importing those.

`DEVELOPMENT` may be looked at while the reader is worked on. `HELD_OUT` may not: it is there to measure what was tuned
on the others.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from PIL import ImageFont

_MATPLOTLIB = "mpl-data/fonts/ttf"
# Name -> the package, and the file in it. Those named font_* come with the extra "dev"
_FILES = {
    "DejaVu Sans": ("matplotlib", f"{_MATPLOTLIB}/DejaVuSans.ttf"),
    "DejaVu Sans Bold": ("matplotlib", f"{_MATPLOTLIB}/DejaVuSans-Bold.ttf"),
    "DejaVu Serif": ("matplotlib", f"{_MATPLOTLIB}/DejaVuSerif.ttf"),
    "DejaVu Sans Mono": ("matplotlib", f"{_MATPLOTLIB}/DejaVuSansMono.ttf"),
    "STIX Bold": ("matplotlib", f"{_MATPLOTLIB}/STIXGeneralBol.ttf"),
    "Atkinson Mono": ("mujoco", "studio/assets/AtkinsonHyperlegibleMono-Regular.ttf"),
    "Roboto": ("font_roboto", "files/Roboto-Regular.ttf"),
    "Roboto Bold": ("font_roboto", "files/Roboto-Bold.ttf"),
    "Source Sans Semibold": ("font_source_sans_pro", "files/SourceSansPro-Semibold.ttf"),
    "Source Serif": ("font_source_serif_pro", "files/SourceSerifPro-Regular.ttf"),
    "Lato": ("font_lato", "files/Lato-Regular.ttf"),
    "Lato Light": ("font_lato", "files/Lato-Light.ttf"),
    "Manrope Semibold": ("font_manrope", "files/Manrope-SemiBold.ttf"),
    "Hanken Grotesk Bold": ("font_hanken_grotesk", "files/HankenGrotesk-Bold.otf"),
    "Caladea": ("font_caladea", "files/Caladea-Regular.ttf"),
    "Fjalla One": ("font_fjallaone", "files/FjallaOne-Regular.ttf"),
    "Red Hat Display": ("font_rhd", "files/RedHatDisplay-Medium.ttf"),
}
_FIRST_HELD_OUT = "Lato"
_NAMES = tuple(_FILES)
DEVELOPMENT = _NAMES[: _NAMES.index(_FIRST_HELD_OUT)]
HELD_OUT = _NAMES[_NAMES.index(_FIRST_HELD_OUT) :]


def missing(names: Sequence[str]) -> list[str]:
    """Packages that would have to be installed for these fonts."""
    return sorted({_FILES[name][0].replace("_", "-") for name in names if font_file(name) is None})


@cache
def font_file(name: str) -> Path | None:
    """The file of a font; None where its package is not installed."""
    package, path = _FILES[name]
    spec = importlib.util.find_spec(package)
    file = Path(spec.origin).parent / path if spec is not None and spec.origin else None
    return file if file is not None and file.is_file() else None


@cache
def font_for_capitals(name: str, height_px: float) -> ImageFont.FreeTypeFont:
    """The font in the size in which an H is that high; raises FileNotFoundError."""
    file = font_file(name)
    if file is None:
        raise FileNotFoundError(f"font {name}: pip install {missing([name])[0]}")
    top, bottom = ImageFont.truetype(str(file), 200).getbbox("H")[1::2]
    return ImageFont.truetype(str(file), 200.0 * height_px / (bottom - top))
