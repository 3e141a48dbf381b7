"""A Chromium without a window, for benchmarks, screenshots and the tests of the page."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from common.errors import StartError

if TYPE_CHECKING:
    from playwright.sync_api import Browser

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
_FLAGS = ["--headless", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"]
_FLAGS += ["--disable-component-update", "--disable-sync"]


@contextmanager
def chromium() -> Iterator[Browser]:
    """Raises StartError where there is none."""
    try:
        from playwright.sync_api import sync_playwright  # of the extra `dev`
    except ImportError as error:
        raise StartError("A browser needs Playwright: run ./deploy/test.sh --setup-only once.") from error
    if CHROMIUM is None:
        raise StartError("There is no Chromium: sudo apt-get install -y chromium")
    flags = [*_FLAGS, *(["--no-sandbox"] if os.geteuid() == 0 else [])]
    # The profile is a new folder each time: Playwright makes it below the folder for temporary files
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        environment: dict[str, str | float | bool] = {**os.environ, "TMPDIR": folder}
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=flags, env=environment)
        yield browser
        browser.close()
