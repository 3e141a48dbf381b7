"""Exports of the map as it is now: `Feed` -> SVG, PNG, CSV; one is made at a time, and whoever waited gets the same.

A picture of a large map takes seconds and half a gigabyte.
"""

from __future__ import annotations

import asyncio
import re
import time
from collections.abc import Hashable
from dataclasses import dataclass
from urllib.parse import quote

from starlette.concurrency import run_in_threadpool

from offboard.export.formats import EXPORTS
from offboard.visualizer.feed import Feed

LIVE_EXPORTS = {name: form.live for name, form in EXPORTS.items() if form.live is not None and not form.missing()}
KEPT_S = 2.0  # for so long an export is given again though the robot drives on


@dataclass(frozen=True, slots=True)
class _Made:
    content: bytes
    drawn: Hashable
    made_s: float


class Exports:
    def __init__(self, feed: Feed) -> None:
        self._feed = feed
        self._made: dict[str, _Made] = {}
        self._one_at_a_time = asyncio.Lock()

    async def get(self, form: str) -> bytes:
        """`form` is one of LIVE_EXPORTS."""
        async with self._one_at_a_time:
            made = self._made.get(form)
            fresh = made is not None and time.monotonic() - made.made_s < KEPT_S
            if made is None or not (fresh or made.drawn == self._feed.drawn()):
                made = self._made[form] = await run_in_threadpool(self._make, form)
            return made.content

    def _make(self, form: str) -> _Made:
        drawn, data = self._feed.drawn(), self._feed.map_data()
        content = LIVE_EXPORTS[form].render(data)
        return _Made(content, drawn, time.monotonic())


def attachment(file_name: str) -> str:
    """The value of Content-Disposition (RFC 6266) for a name of any letters."""
    plain = re.sub(r"[^\w.-]", "_", file_name, flags=re.ASCII)
    return f"attachment; filename=\"{plain}\"; filename*=UTF-8''{quote(file_name, safe='')}"
