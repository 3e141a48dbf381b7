"""The mapping unit over the odometry and ranges of a recorded run, wherever it is run: `LOG.jsonl OUT.npz`.

Needs nothing but what a board has: `common`, `onboard`, and their packages.
"""

from __future__ import annotations

import json
import logging
import sys
import time
from pathlib import Path

import numpy as np

from common.messages.motion import Odometry, Ranges
from onboard.mmu.back_end.map_builder import deferred_back_end
from onboard.mmu.slam import Slam


def numbers(values: list[float | None]) -> tuple[float, ...]:
    """JSON has no NaN: null stands for it."""
    return tuple(float("nan") if value is None else value for value in values)


class Lines(logging.Handler):
    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(record.getMessage())


def main(log: Path, result: Path) -> None:
    lines = Lines()
    logging.basicConfig(level=logging.INFO, handlers=[lines])
    worker = deferred_back_end()
    slam = Slam(worker)
    times_s, online = [], []
    began_s = time.process_time()
    for text in log.read_text(encoding="utf-8").splitlines():
        message = json.loads(text)
        if "range_m" in message:
            message |= {name: numbers(message[name]) for name in ("range_m", "age_s")}
            slam.add_ranges(Ranges(**message))
            continue
        slam.add_odometry(Odometry(**message))
        worker.work()
        times_s.append(message["t_s"])
        online.append(slam.pose.as_array())
    cost_s = time.process_time() - began_s
    closures = [line for line in lines.lines if line.startswith("loop closure")]
    np.savez(
        result, times_s=times_s, online=online, points=slam.wall_points(), closures=np.array(closures), cost_s=cost_s
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
