"""A recorded run played on the page: the messages of its database -> `Feed`, at any speed and from any moment on.

Times are those of arrival at the recorder, from the first message on. All pages of a server look at the same moment.
"""

from __future__ import annotations

import logging
import threading
import time
from bisect import bisect_right
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from common.errors import StartError, sentence
from common.messages.topics import LOG, MAP, PERMIT, PLAN, POI, POSE, RANGES, TRAJECTORY, Topic
from offboard.runs.moments import moments_of
from offboard.runs.run_database import Message, RunReader
from offboard.visualizer.feed import Feed

SPEED_MAX = 100.0
MOMENTS_MAX = 400
LINES_MAX = 3000  # of the log, the newest: 400 kB for a page
_STEP_S = 0.05
_SHOWN: tuple[Topic[Any], ...] = (POSE, RANGES, MAP, TRAJECTORY, PLAN, PERMIT, POI)

_log = logging.getLogger("view")


@dataclass(frozen=True, slots=True)
class LoggedLine:
    """A line of the log, and its moment."""

    at_s: float
    level: str
    module: str
    text: str


@dataclass(frozen=True, slots=True)
class PlaybackView:
    """Where the page is in the run; `speed` 0 stands still. At the end it shows the files of the run."""

    at_s: float
    duration_s: float
    speed: float = 0.0


class Playback:
    """`show` may be called by any thread; another one reads the database and plays it."""

    def __init__(self, run_dir: Path, feed: Feed) -> None:
        self._run_dir, self._feed = run_dir, feed
        self._messages: list[Message[Any]] = []
        self._times_s: list[float] = []
        self._next = 0
        self._wanted: list[tuple[float | None, float]] = []
        self._woken, self._ended = threading.Event(), threading.Event()
        self._view = PlaybackView(0.0, 0.0)
        self._thread = threading.Thread(target=self._run, name="playback", daemon=True)

    def open(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        self._woken.set()
        if self._thread.is_alive():
            self._thread.join(5.0)

    def show(self, at_s: float | None, speed: float) -> None:
        """From this moment on (None: from where it is), so many times as fast as it was."""
        self._wanted.append((at_s, min(max(speed, 0.0), SPEED_MAX)))
        self._woken.set()

    def _run(self) -> None:
        try:
            self._load()
        except (StartError, OSError) as error:
            _log.warning("the run cannot be played: %s", sentence(error))
            return
        before_s = time.monotonic()
        while not self._ended.is_set():
            self._woken.clear()
            now_s = time.monotonic()
            self._step(now_s - before_s)
            before_s = now_s
            self._woken.wait(_STEP_S if self._view.speed else None)

    def _load(self) -> None:
        with RunReader(self._run_dir) as run:
            self._messages = list(run.messages(*_SHOWN))
            lines = list(run.messages(*LOG.values()))
        if not self._messages:
            return
        began_s = self._messages[0].arrived_s
        self._times_s = [message.arrived_s - began_s for message in self._messages]
        moments = [moment for moment in moments_of(self._messages, lines, began_s) if moment.at_s >= 0.0]
        self._feed.take_moments(tuple(moments[:MOMENTS_MAX]))
        logged = [
            LoggedLine(round(line.arrived_s - began_s, 2), line.payload.level, line.topic.producer, line.payload.text)
            for line in lines[-LINES_MAX:]
        ]
        self._feed.take_log(tuple(logged))
        self._next = len(self._messages)
        self._publish(PlaybackView(self._times_s[-1], self._times_s[-1]))

    def _step(self, passed_s: float) -> None:
        view = self._view
        while self._wanted:
            at_s, speed = self._wanted.pop(0)
            # From the end on there is nothing to play but the run from its beginning
            from_end = at_s is None and speed > 0.0 and view.at_s >= view.duration_s
            view = replace(view, at_s=0.0 if from_end else view.at_s if at_s is None else at_s, speed=speed)
            if at_s is not None or from_end:
                view = replace(view, at_s=min(max(view.at_s, 0.0), view.duration_s))
                self._jump(view.at_s)
            passed_s = 0.0
        if view.speed:
            view = replace(view, at_s=min(view.at_s + passed_s * view.speed, view.duration_s))
            self._go_on(view.at_s)
        if view.at_s >= view.duration_s:
            view = replace(view, speed=0.0)
        self._publish(view)

    def _jump(self, at_s: float) -> None:
        self._next = bisect_right(self._times_s, at_s)
        self._feed.begin_anew((message.topic, message.payload) for message in self._messages[: self._next])

    def _go_on(self, at_s: float) -> None:
        end = bisect_right(self._times_s, at_s)
        self._feed.take_many((message.topic, message.payload) for message in self._messages[self._next : end])
        self._next = max(self._next, end)

    def _publish(self, view: PlaybackView) -> None:
        if view != self._view:
            self._view = view
            self._feed.take_playback(view)
