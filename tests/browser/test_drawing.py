"""The exported SVG in a real Chromium: on its screen, and on paper."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from offboard.export.map_picture import as_svg
from tests.unit.export_scenes import hall, run_tool

CSS_PX_PER_MM = 96 / 25.4


def test_a_wide_svg_has_its_size_on_the_screen_and_as_one_page_of_its_own_in_print(
    browser: Browser, tmp_path: Path
) -> None:
    svg, pdf = tmp_path / "map.svg", tmp_path / "printed.pdf"
    svg.write_text(as_svg(hall(60.0)))
    page = browser.new_page()
    page.goto(svg.as_uri())
    width_px = page.evaluate("document.querySelector('path.walls').getBBox().width")
    assert width_px == pytest.approx(600.0, abs=0.5)  # in the units of the viewBox, which are millimetres
    drawn_px = page.evaluate("document.querySelector('path.walls').getBoundingClientRect().width")
    assert drawn_px / CSS_PX_PER_MM == pytest.approx(600.0, abs=1.5)
    page.pdf(path=pdf, prefer_css_page_size=True)
    page.close()
    said = run_tool("poppler-utils", "pdfinfo", pdf)
    (width,) = re.findall(r'width="([\d.]+)mm"', svg.read_text()[:400])
    ((width_pt, _),) = re.findall(r"Page size: +([\d.]+) x ([\d.]+) pts", said)
    assert float(width_pt) / 72 * 25.4 == pytest.approx(float(width), abs=0.5)
    assert re.search(r"Pages: +1\n", said)
