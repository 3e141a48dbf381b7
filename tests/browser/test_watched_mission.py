"""A simulated mission watched in a real Chromium, from the first wall to the end of the mesh and beyond."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import expect

from common.config_file import load_config
from tests.browser.conftest import Visit
from tests.system.conftest import ROOT, children_of, environment, local_run

pytestmark = [pytest.mark.timeout(900), pytest.mark.slow]

Open = Callable[..., Visit]

MISSION_S = 600.0
STALE_WITHIN_MS = 1500
POIS = "() => import('./main.js').then(({ model }) => model.pois.map((poi) => [poi.poi_id, poi.has_photo]))"
# How long after the last message the page says that its data are old
NOTE_SILENCE = """() => import('./main.js').then(({ model }) => {
    window.silent_ms = null;
    let last = performance.now();
    const take = model.take.bind(model);
    model.take = (channel, message) => {
        last = performance.now();
        take(channel, message);
    };
    new MutationObserver(() => {
        const old = ["stale", "silent"].includes(document.body.dataset.link);
        if (old && window.silent_ms === null) window.silent_ms = performance.now() - last;
    }).observe(document.body, { attributeFilter: ["data-link"] });
})"""


def freeze(seen: Visit, server: int) -> None:
    """The page's server stands still with its sockets open: the page says so in time, and is live again afterwards."""
    seen.page.evaluate(NOTE_SILENCE)
    os.kill(server, signal.SIGSTOP)
    try:
        seen.until(lambda: seen.page.evaluate("window.silent_ms") is not None, "STALE")
    finally:
        os.kill(server, signal.SIGCONT)
    assert seen.page.evaluate("window.silent_ms") <= STALE_WITHIN_MS
    seen.until_link("live")


def look_at(seen: Visit, poi_id: int, *, photo: bool) -> None:
    """Opens a point of interest, waits for what it has to show, closes it."""
    seen.page.evaluate("(id) => { location.hash = `#poi=${id}`; }", poi_id)
    dialog = seen.page.locator("#poi")
    expect(dialog).to_be_visible()
    expect(dialog.locator("[data-field=place]")).to_contain_text("m from the start")
    if photo:
        image = dialog.locator("img")
        seen.until(lambda: image.evaluate("image => image.naturalWidth") > 0, f"the photo of number {poi_id}", 20.0)
    seen.page.keyboard.press("Escape")
    expect(dialog).to_be_hidden()


def test_a_mission_is_watched_to_its_end_and_beyond(tmp_path: Path, visit: Open) -> None:
    """Floor `straight` with its camera, at five times the pace: three to eight minutes."""
    folder = tmp_path / "run"
    with local_run(folder, "--speed", "5", "--camera", "realistic") as mesh:
        assert mesh.stdout is not None
        threading.Thread(target=mesh.stdout.read, daemon=True).start()
        address = load_config(folder / "process" / "robot.toml").visualizer
        seen = visit(None, at=f"http://{address.host}:{address.port}/")
        page = seen.page
        seen.until_link("live")
        seen.until(lambda: seen.wall_pixels() > 200, "walls", 120.0)
        freeze(seen, children_of(folder)["visualizer"])
        looked_at: set[int] = set()
        end_s = time.monotonic() + MISSION_S
        while page.locator("#phases .past").count() < 4:
            assert time.monotonic() < end_s, page.locator("#mission-state").inner_text()
            for poi_id, photo in page.evaluate(POIS):
                if photo and poi_id not in looked_at:
                    look_at(seen, poi_id, photo=True)
                    looked_at.add(poi_id)
            page.wait_for_timeout(500)
        expect(page.locator("#mission-state")).to_contain_text(re.compile("finished, and home", re.IGNORECASE))
        expect(page.locator("#notice")).to_contain_text("The mission has ended: finished, and home.")
        mesh.wait(60.0)
        ended = "['ended', 'lost'].includes(document.body.dataset.link)"
        seen.until(lambda: page.evaluate(ended), "the end of the server", 30.0)
        expect(page.locator("#banner")).to_contain_text(f"indoor-mapping view {folder}")
    assert len(looked_at) >= 6, "of the 8 doors of that floor"
    walls = seen.wall_pixels()
    assert walls > 200, "the map stays"
    command = [sys.executable, "-m", "deploy.cli", "view", str(folder), "--port", str(address.port)]
    with subprocess.Popen(command, cwd=ROOT, env=environment()) as view:
        try:
            seen.until(lambda: page.evaluate("document.body.dataset.link") == "recorded", "the recorded run", 60.0)
            for poi_id, photo in page.evaluate(POIS):
                look_at(seen, poi_id, photo=photo)
            expect(page.locator("#clock")).to_contain_text(re.compile(r"(\d+:\d\d) / \1"))
        finally:
            view.send_signal(signal.SIGINT)
    hosts = {re.sub(r"^\w+://([^/]+)/.*", r"\1", request) for request in seen.asked if "://" in request}
    assert hosts == {f"{address.host}:{address.port}"}
