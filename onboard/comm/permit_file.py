"""The permit as a file in the service's runtime folder, for `deploy`: it changes nothing while the robot may move.

systemd names the folder, which is in memory: nothing waits for a disk, and nothing of it outlives a power cut.
"""

from __future__ import annotations

import logging
import os
from pathlib import Path

NAME = "permit"
GRANTED, WITHHELD = "granted", "withheld"

_log = logging.getLogger("comm")


class PermitFile:
    """Holds one word."""

    def __init__(self, file: Path) -> None:
        self._file = file

    def write(self, *, granted: bool) -> None:
        """Before the permit is published: the file never lags behind a permit that is granted."""
        new = self._file.with_suffix(".new")
        try:
            new.write_text(GRANTED if granted else WITHHELD, encoding="utf-8")
            new.replace(self._file)
        except OSError as error:
            _log.warning("the permit file cannot be written error=%s", error.strerror)


def permit_file() -> PermitFile | None:
    """In the folder that systemd made for the service; None where it has none."""
    folder = os.environ.get("RUNTIME_DIRECTORY")
    return PermitFile(Path(folder) / NAME) if folder else None
