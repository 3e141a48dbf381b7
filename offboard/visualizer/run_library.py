"""Recorded runs below one folder as pages: a list with pictures and figures, each run at an address of its own.

`/run/NAME/` is the page of a run, `/over/NAME/OTHER/` the same with the walls of another run over it.
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from pathlib import Path
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import Receive, Scope, Send
from starlette.websockets import WebSocketClose

from common.errors import StartError, sentence
from offboard.runs.run_folder import RunFolderError, files_of_run, read_map
from offboard.runs.run_list import RunLine, find_runs
from offboard.visualizer.feed_site import FeedSite
from offboard.visualizer.guards import PAGE
from offboard.visualizer.run_overlay import RunOverlay
from offboard.visualizer.run_view import recorded_run
from offboard.visualizer.thumbnail import thumbnail

OPEN_MAX = 4  # runs that are held in memory at a time
_TITLES = {"coverage": "Coverage", "map_rmse_m": "Map rmse", "home_m": "Off home", "ate_fit_m": "Path error"}


def is_library(folder: Path) -> bool:
    """Whether it holds runs and is none itself."""
    if not folder.is_dir() or files_of_run(folder):
        return False
    return any(files_of_run(below) for below in folder.iterdir() if below.is_dir())


def run_site(here: Path, there: Path | None = None) -> FeedSite:
    """The page of a run, with the walls of another one over it. Raises RunFolderError."""
    run = recorded_run(here)
    if there is not None and not files_of_run(there):
        raise RunFolderError(f"There is no recorded run at {there}; `indoor-mapping runs` lists the runs.")
    overlay = RunOverlay(here, there) if there is not None else None
    return FeedSite(run.feed, here.resolve().name, playback=run.playback, overlay=overlay)


class RunLibrary:
    """A `Site` of many runs."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._sites: OrderedDict[tuple[str, str], FeedSite] = OrderedDict()
        self._one_at_a_time = asyncio.Lock()
        self.routes: list[BaseRoute] = [
            Route("/", lambda _: FileResponse(PAGE / "runs.html")),
            Route("/runs.json", self._list),
            Route("/thumbnails/{name}.png", self._thumbnail),
            Mount("/run/{name}", self._run),
            Mount("/over/{name}/{other}", self._run),
            Mount("/", StaticFiles(directory=PAGE)),
        ]

    @property
    def pages(self) -> int:
        return sum(site.pages for site in self._sites.values())

    def open(self) -> None:
        """A run is opened when somebody wants to see it."""

    def close(self) -> None:
        for site in self._sites.values():
            site.close()

    # Endpoints; those that are not `async` run in a thread of their own

    def _list(self, _: Request) -> Response:
        try:
            runs = find_runs([self._folder])
        except (StartError, OSError) as error:
            return PlainTextResponse(sentence(error), 404)
        own = [run for run in reversed(runs) if run.folder.parent == self._folder]
        return JSONResponse({"folder": str(self._folder), "runs": [_shown(run) for run in own]})

    def _thumbnail(self, request: Request) -> Response:
        try:
            data = read_map(self._existing(request.path_params["name"]))
        except (StartError, OSError) as error:
            return PlainTextResponse(sentence(error), 404)
        return Response(thumbnail(data), media_type="image/png")

    async def _run(self, scope: Scope, receive: Receive, send: Send) -> None:
        names = scope["path_params"]
        try:
            site = await self._site(names["name"], names.get("other", ""))
        except (StartError, OSError) as error:
            refusal = PlainTextResponse(sentence(error), 404) if scope["type"] == "http" else WebSocketClose()
            await refusal(scope, receive, send)
            return
        await site(scope, receive, send)

    async def _site(self, name: str, other: str) -> FeedSite:
        async with self._one_at_a_time:
            key = name, other
            if key not in self._sites:
                site = await run_in_threadpool(self._opened, name, other)
                self._make_room()
                site.open()
                self._sites[key] = site
            self._sites.move_to_end(key)
            return self._sites[key]

    def _opened(self, name: str, other: str) -> FeedSite:
        return run_site(self._existing(name), self._existing(other) if other else None)

    def _make_room(self) -> None:
        """Closes what was looked at longest ago. Raises StartError where all are looked at."""
        if len(self._sites) < OPEN_MAX:
            return
        unwatched = next((key for key, site in self._sites.items() if not site.pages), None)
        if unwatched is None:
            raise StartError(f"{OPEN_MAX} runs are open, and more may not be: close the page of one.")
        self._sites.pop(unwatched).close()

    def _existing(self, name: str) -> Path:
        folder = self._folder / name
        if name in ("", ".", "..") or "\0" in name or not folder.is_dir() or not files_of_run(folder):
            raise RunFolderError("There is no such run here.")
        return folder


def _shown(run: RunLine) -> dict[str, Any]:
    figures = {
        _TITLES.get(name, name): f"{100 * value:.0f} %" if name == "coverage" else f"{value:.3f} m"
        for name, value in run.figures.items()
    }
    minutes, seconds = divmod(round(run.duration_s or 0.0), 60)
    return {
        "name": run.folder.name,
        "date": f"{run.date:%Y-%m-%d %H:%M}",
        "floor": run.floor,
        "duration": f"{minutes}:{seconds:02} min",
        "end": run.end_text,
        "figures": figures,
        "damage": run.damage,
    }
