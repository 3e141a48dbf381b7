"""The pictures of the map in the run folder. A large map takes some seconds and a gigabyte.

`python -m offboard.recorder.pictures RUN`: the same in a process of the lowest priority, which the recorder starts.
"""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
from pathlib import Path

from common.errors import StartError, sentence
from offboard.export.formats import EXPORTS, title

_PICTURES = ("svg", "png")

_log = logging.getLogger("recorder")


def draw(run_dir: Path) -> None:
    """From the files of the folder; where there is no picture, a line in the log gives the reason."""
    try:
        for name in _PICTURES:
            EXPORTS[name].of_run(run_dir, run_dir, title(run_dir))
    except (StartError, OSError) as error:
        _log.warning("no picture of the map: %s", sentence(error))


def draw_apart(run_dir: Path) -> None:
    """As `draw`, in another process; returns when it has ended."""
    command = [sys.executable, "-m", "offboard.recorder.pictures", str(run_dir)]
    ended = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    lines = ended.stderr.splitlines()
    if ended.returncode:
        lines = [f"no picture of the map exit={ended.returncode} {lines[-1] if lines else ''}"]
    for line in lines:
        _log.warning(line)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the recorder waits for this one
    os.nice(19)
    logging.basicConfig(format="%(message)s")
    draw(Path(sys.argv[1]))
