"""The page on paper: markers where the map has them, and a scale bar that is right there."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from tests.browser.conftest import Robot, Visit

pytestmark = [
    pytest.mark.timeout(60),
    pytest.mark.skipif(shutil.which("pdftoppm") is None, reason="no pdftoppm: sudo apt-get install -y poppler-utils"),
]

Open = Callable[..., Visit]
Pixels = npt.NDArray[np.int16]

DPI = 200
MM_PER_PX = 25.4 / DPI
ASTERISK, WALL = (0xC4, 0x12, 0x1C), (0x1C, 0x27, 0x33)


def sheets(pdf: bytes, folder: Path) -> list[Pixels]:
    """The pages of a PDF as pixels (rows, columns, 3)."""
    (folder / "map.pdf").write_bytes(pdf)
    command = ["pdftoppm", "-r", str(DPI), "-png", "map.pdf", "sheet"]
    subprocess.run(command, cwd=folder, check=True, timeout=30)
    return [np.asarray(Image.open(file).convert("RGB"), np.int16) for file in sorted(folder.glob("sheet*.png"))]


def places_mm(page: Pixels, colour: tuple[int, int, int], slack: int = 30) -> npt.NDArray[np.float64]:
    """(N, 2) where on the sheet it has that colour, to the right and down."""
    rows, columns = np.nonzero(np.abs(page - np.array(colour, np.int16)).sum(axis=2) < slack)
    return np.column_stack([columns, rows]) * MM_PER_PX


@pytest.mark.requirement("VSL_MR_04")
@pytest.mark.parametrize("look", [{}, {"viewport": {"width": 390, "height": 800}, "color_scheme": "dark"}])
def test_a_printed_map_has_its_doors_on_the_walls_and_a_right_scale_bar(
    robot: Robot, visit: Open, tmp_path: Path, look: dict[str, Any]
) -> None:
    """A wall of 7.9 m, on it doors at 1.5 m, 2.5 m and 3.5 m."""
    robot.wall(0.0)
    for number in (1, 2, 3):
        robot.door(number, f"10{number}")
    robot.pose(x_m=1.0, y_m=1.0)
    seen = visit(robot, **look)
    seen.until_live(robot)
    before = seen.page.locator('.marker[data-poi="1"]').bounding_box()
    seen.page.evaluate(
        """() => addEventListener("beforeprint", () => {
            const bar = document.getElementById("scale-bar");
            window.bar = [bar.textContent.trim(), parseFloat(bar.querySelector("i").style.width)];
        })"""
    )
    pages = sheets(seen.page.pdf(prefer_css_page_size=True), tmp_path)
    text, bar_px = seen.page.evaluate("window.bar")
    metres, ratio = (float(part) for part in text.replace(" m · 1 :", "").split())
    assert len(pages) == 1
    mm_per_m = bar_px / metres / 96 * 25.4
    assert 1000 / mm_per_m == pytest.approx(ratio, rel=0.01), "what the bar says is what it is"
    wall = places_mm(pages[0], WALL)
    wall = wall[np.abs(wall[:, 1] - np.median(wall[:, 1])) < 2.0]
    width_mm = max(0.09, 2 / (bar_px / metres)) * mm_per_m  # of its stroke, half of it beyond its end
    start_mm = wall[:, 0].max() - width_mm / 2 - 7.9 * mm_per_m  # its beginning lies below the mark of the start
    stars = places_mm(pages[0], ASTERISK)
    for door in (1.5, 2.5, 3.5):
        near = stars[np.abs(stars[:, 0] - start_mm - door * mm_per_m) < 0.4 * mm_per_m]
        assert len(near), f"no asterisk for the door at {door} m"
        middle = (near.min(axis=0) + near.max(axis=0)) / 2
        assert middle[0] - start_mm == pytest.approx(door * mm_per_m, abs=0.5)
        assert middle[1] == pytest.approx(np.median(wall[:, 1]), abs=0.5)
    seen.until(lambda: seen.page.locator('.marker[data-poi="1"]').bounding_box() == before, "the screen as before")
