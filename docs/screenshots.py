"""Takes the pictures of the programs on these pages, from a simulated mission that runs meanwhile.

    .venv/bin/python docs/screenshots.py

The mesh is that of `indoor-mapping local`, as real processes; the page is in a real Chromium, the Command Center in a
terminal of its own. They are taken once the robot has found so many doors, and differ a little each time.
"""

from __future__ import annotations

import fcntl
import os
import pty
import re
import signal
import struct
import subprocess
import sys
import tempfile
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from deploy.bench.browser import chromium

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

DOCS = Path(__file__).resolve().parent
FLOOR, SPEED = "loop", 1  # at another pace the rates that the terminal shows are not those of a robot
DOORS = 9  # of twelve are found when the pictures are taken: most of the floor is on the map
VIEWPORT = {"width": 1440, "height": 900}
COLUMNS, ROWS = 150, 42  # of the terminal
TERMINAL_S = 15  # after which the Command Center's picture is taken
MISSION_S = 1800.0
END_S = 40.0
_DOORS_FOUND = "() => import('./main.js').then(({ model }) => model.pois.length)"


@contextmanager
def mission(folder: Path) -> Iterator[str]:
    """The address of the page of a mission that runs. It is ended afterwards."""
    command = [sys.executable, "-m", "deploy.cli", "local", "--headless", "--floor", FLOOR, "--speed", str(SPEED)]
    command += ["--camera", "realistic", "--out", str(folder)]
    mesh = subprocess.Popen(command, cwd=DOCS.parent, stdout=subprocess.PIPE, text=True)
    try:
        assert mesh.stdout is not None
        for line in mesh.stdout:
            found = re.search(r"The live map: (\S+)", line)
            if found:
                threading.Thread(target=mesh.stdout.read, daemon=True).start()
                yield found[1]
                return
        raise SystemExit("The mesh did not start.")
    finally:
        mesh.send_signal(signal.SIGINT)
        mesh.wait(END_S)


@contextmanager
def command_center(folder: Path, picture: Path) -> Iterator[None]:
    """The Command Center beside that mission, in a terminal; Textual writes the picture (SVG), and it ends."""
    control, terminal = pty.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
    wishes = {"TEXTUAL_SCREENSHOT": str(TERMINAL_S), "TEXTUAL_SCREENSHOT_LOCATION": str(picture.parent)}
    environment = os.environ | wishes | {"TEXTUAL_SCREENSHOT_FILENAME": picture.name, "TERM": "xterm-256color"}
    environment["COLORTERM"] = "truecolor"
    work = folder / "process"
    command = [sys.executable, "-m", "offboard.command_center", "--config", str(work / "robot.toml")]
    command += ["--log-dir", str(work), "--run-dir", str(folder)]
    program = subprocess.Popen(
        command, cwd=DOCS.parent, stdin=terminal, stdout=terminal, stderr=terminal, env=environment
    )
    os.close(terminal)

    def read_on() -> None:
        with suppress(OSError):
            while os.read(control, 65536):
                pass

    threading.Thread(target=read_on, daemon=True).start()
    try:
        yield
        program.wait(2 * TERMINAL_S + END_S)
    finally:
        program.terminate()
        program.wait()


def until(condition: Callable[[], bool], what: str) -> None:
    end_s = time.monotonic() + MISSION_S
    while not condition():
        if time.monotonic() > end_s:
            raise SystemExit(f"{what} did not come.")
        time.sleep(0.5)


def take_page(browser: Browser, address: str) -> None:
    """Light, dark, and on a telephone with a door open."""
    page: Page = browser.new_page(viewport=VIEWPORT)  # type: ignore[arg-type]
    page.goto(address)
    page.locator("header .stop").wait_for()
    until(lambda: page.evaluate(_DOORS_FOUND) >= DOORS, f"{DOORS} doors")
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
        page.wait_for_timeout(1500)
        page.screenshot(path=DOCS / f"page-{scheme}.png")
    page.emulate_media(color_scheme="light")
    read = page.evaluate("() => import('./main.js').then(({ model }) => model.pois.find((p) => p.number)?.poi_id ?? 1)")
    page.evaluate("(id) => { location.hash = `#poi=${id}`; }", read)
    page.locator("#poi img").wait_for()
    page.wait_for_timeout(1500)
    page.screenshot(path=DOCS / "page-door.png")
    page.close()


def take_terminal(browser: Browser, picture: Path) -> None:
    """The picture that Textual made, as pixels, in this machine's own font: its own is fetched from the internet."""
    svg = re.sub(r"@font-face\s*{.*?}", "", picture.read_text(encoding="utf-8"), flags=re.DOTALL)
    svg = svg.replace("Fira Code", "DejaVu Sans Mono")
    page = browser.new_page(viewport=VIEWPORT)  # type: ignore[arg-type]
    page.set_content(f"<style>body {{ margin: 0 }} svg {{ display: block; width: 1440px; height: auto }}</style>{svg}")
    page.locator("svg").screenshot(path=DOCS / "command_center.png")
    page.close()


def main() -> None:
    with tempfile.TemporaryDirectory(prefix="indoor-mapping-") as name, chromium() as browser:
        folder, picture = Path(name) / "run", Path(name) / "terminal.svg"
        with mission(folder) as address:
            take_page(browser, address)
            with command_center(folder, picture):
                pass
        take_terminal(browser, picture)


if __name__ == "__main__":
    main()
