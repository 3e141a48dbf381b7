"""How well floors are explored: whole missions in lockstep without camera, on our own floors or those of a folder.

The way counts against the shortest closed walk through the hall centrelines (`tour_ratio`), where the floor file has
it, else against twice their length (`ratio`).
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from common.environment import PROCESS_ENVIRONMENT
from deploy.bench.mission import HERE
from deploy.bench.order import Order
from offboard.runs.run_folder import SUMMARY_NAME
from offboard.simulator.run.options import FLOORS

COLUMNS = (
    "tour_ratio",
    "ratio",
    "halls",
    "coverage",
    "wall_rule",
    "path_m",
    "simulated_time_s",
    "home_m",
    "clearance_m",
)
NAME_WIDTH = 26
WIDTH = 11  # of a column of figures

Summary = Mapping[str, Any]


def bench(order: Order) -> None:
    """Prints a line for every mission, then mean and extremes. Quick: the first start of each floor only."""
    files = sorted((order.floors or FLOORS).glob("*.json"))
    print(HEAD, flush=True)
    summaries: list[Summary] = []
    with tempfile.TemporaryDirectory(prefix="indoor-mapping-") as folder:
        for number, (file, start) in enumerate(_missions(files, order.quick)):
            summaries.append(_run(file, start, Path(folder) / str(number)))
            print(line(f"{file.stem} {start}", summaries[-1]), flush=True)
    print(*totals(summaries), sep="\n")


def _missions(files: Sequence[Path], quick: bool) -> Iterator[tuple[Path, int]]:
    """Floor files, and each of their starts."""
    for file in files:
        starts = len(json.loads(file.read_text(encoding="utf-8"))["starts"])
        yield from ((file, start) for start in range(1 if quick else starts))


def _run(floor: Path, start: int, out: Path) -> Summary:
    """The summary of one mission. The seed is the start, so that starts differ in their errors too."""
    command = [sys.executable, "-m", "deploy.cli", "simulate", "--camera", "off", "--floor", str(floor.resolve())]
    command += ["--start", str(start), "--seed", str(start), "--out", str(out)]
    environment = os.environ | PROCESS_ENVIRONMENT | {"PYTHONPATH": str(HERE)}
    subprocess.run(command, cwd=HERE, env=environment, stdout=subprocess.DEVNULL, check=False)  # its outcome is printed
    summary: Summary = json.loads((out / SUMMARY_NAME).read_text(encoding="utf-8"))
    return summary


HEAD = f"{'floor, start':{NAME_WIDTH}}" + "".join(f"{name.removeprefix('simulated_'):>{WIDTH}}" for name in COLUMNS)


def line(name: str, figures: Summary) -> str:
    """The figures of a mission, and how it ended."""
    values = [figures.get(column) for column in COLUMNS]
    texts = [f"{value:{WIDTH}.3f}" if isinstance(value, float) else " " * (WIDTH - 1) + "-" for value in values]
    return f"{name:{NAME_WIDTH}}{''.join(texts)}  {figures.get('outcome', '')}"


def totals(summaries: Sequence[Summary]) -> list[str]:
    """Mean, smallest and largest of every column, over the missions that have it."""
    lines = []
    for name, of in (("mean", statistics.fmean), ("least", min), ("most", max)):
        columns = {column: [s[column] for s in summaries if isinstance(s.get(column), float)] for column in COLUMNS}
        lines.append(line(name, {column: float(of(values)) for column, values in columns.items() if values}))
    return [*lines, f"finished: {sum(bool(s.get('finished')) for s in summaries)} of {len(summaries)}"]
