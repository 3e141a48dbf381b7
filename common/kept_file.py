"""What a node keeps in a file that outlives its restarts: written whole beside the steps whenever it has changed."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from common.disk_worker import disk_worker
from common.side_work import SideWorker

RETRY_S = 1.0  # after the disk refused
LOOK_S = 0.05  # between two looks whether the disk is done


class KeptFile:
    """Without a file nothing is kept, for lockstep and tests. `revision` grows with every change."""

    def __init__(self, file: Path | None, content: Callable[[], Any], log: logging.Logger) -> None:
        """`content`: what the file is to hold now, for JSON; called by the disk's thread."""
        self._file, self._content, self._log = file, content, log
        self._disk: SideWorker[Callable[[], Any], Any] | None = None  # once there is something to store
        self._retry_s = float("-inf")
        self.revision = self._stored = 0

    def changed(self) -> None:
        self.revision += 1

    def step(self, now_s: float) -> None:
        """Stores what has changed."""
        outcome = self._disk.result(now_s) if self._disk is not None else None
        if outcome is not None and outcome.error is not None:
            self._refused(outcome.error)
            self._retry_s = now_s + RETRY_S
        elif outcome is not None and outcome.value is not None:
            self._stored = outcome.value
        if self._file is None or not self._to_store or now_s < self._retry_s:
            return
        self._disk = self._disk or disk_worker(self._file.stem)
        if not self._disk.busy:
            self._disk.begin(self._store, now_s)

    def due_s(self, now_s: float) -> float:
        """When `step` has something to do (s)."""
        if self._disk is not None and self._disk.busy:
            return now_s + LOOK_S
        return max(now_s, self._retry_s) if self._to_store else float("inf")

    def close(self) -> None:
        """Stores what is not yet."""
        outcome = self._disk.close() if self._disk is not None else None
        if outcome is not None and outcome.value is not None:
            self._stored = outcome.value
        if self._to_store:
            try:
                self._store()
            except OSError as error:
                self._refused(error)

    @property
    def _to_store(self) -> bool:
        return self._file is not None and self._stored != self.revision

    def _store(self) -> int:
        """The revision that the disk has then."""
        revision, content = self.revision, self._content()  # in this order: what is newer is stored once more
        if self._file is not None:
            write_json(self._file, content)
        return revision

    def _refused(self, error: Exception) -> None:
        self._log.error("not stored file=%s error=%s", self._file, error)


def write_json(file: Path, content: Any) -> None:
    """Durable when it returns. Raises OSError, and then the old one is still there."""
    part = file.with_suffix(".part")
    with part.open("w", encoding="utf-8") as stream:
        json.dump(content, stream)
        stream.flush()
        os.fsync(stream.fileno())
    part.replace(file)
