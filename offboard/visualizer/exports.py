"""Exports for the page: of the map as it is now, or of a recorded run in every format that there is.

One is made at a time, and of the map of now whoever waited gets the same: a picture of a large map takes seconds and
half a gigabyte.
"""

from __future__ import annotations

import asyncio
import re
import time
from collections.abc import Hashable
from dataclasses import dataclass
from mimetypes import guess_type
from pathlib import Path
from urllib.parse import quote

from starlette.concurrency import run_in_threadpool

from offboard.export.formats import EXPORTS, as_one_file, formats_of
from offboard.export.title import TitleBlock
from offboard.visualizer.feed import Feed

LIVE_EXPORTS = {name: form.live for name, form in EXPORTS.items() if form.live is not None and not form.missing()}
KEPT_S = 2.0  # for so long an export is given again though the robot drives on


@dataclass(frozen=True, slots=True)
class Download:
    """A file; `name` without what it is a file of."""

    name: str
    media_type: str
    content: bytes


@dataclass(frozen=True, slots=True)
class _Made:
    file: Download
    drawn: Hashable
    made_s: float


class Exports:
    def __init__(self, feed: Feed) -> None:
        self._feed = feed
        self._made: dict[str, _Made] = {}
        self._one_at_a_time = asyncio.Lock()
        self._run_dir = Path(feed.run.name) if feed.run.recorded else None
        self.offered = tuple(LIVE_EXPORTS if self._run_dir is None else formats_of(self._run_dir))

    async def get(self, form: str) -> Download:
        """`form` is one of `offered`. Raises StartError, OSError for a recorded run that is damaged."""
        if self._run_dir is not None:
            async with self._one_at_a_time:
                return await run_in_threadpool(_of_run, self._run_dir, form)
        async with self._one_at_a_time:
            made = self._made.get(form)
            fresh = made is not None and time.monotonic() - made.made_s < KEPT_S
            if made is None or not (fresh or made.drawn == self._feed.drawn()):
                made = self._made[form] = await run_in_threadpool(self._make, form)
            return made.file

    def _make(self, form: str) -> _Made:
        drawn, data = self._feed.drawn(), self._feed.map_data()
        content = LIVE_EXPORTS[form].render(data)
        return _Made(Download(f"map.{form}", LIVE_EXPORTS[form].media_type, content), drawn, time.monotonic())


def _of_run(run_dir: Path, form: str) -> Download:
    name, content = as_one_file(run_dir, form, TitleBlock(run_dir.resolve().name))
    live = EXPORTS[form].live
    media_type = live.media_type if live is not None else guess_type(name)[0]
    return Download(name, media_type or "application/octet-stream", content)


def attachment(file_name: str) -> str:
    """The value of Content-Disposition (RFC 6266) for a name of any letters."""
    plain = re.sub(r"[^\w.-]", "_", file_name, flags=re.ASCII)
    return f"attachment; filename=\"{plain}\"; filename*=UTF-8''{quote(file_name, safe='')}"
