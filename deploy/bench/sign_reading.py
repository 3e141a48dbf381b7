"""What the reading of signs is worth and costs: rendered signs read, and a full frame's time by stage with its memory.

The signs are those of `offboard/evaluate/signs`. A full frame is one of 1280 x 960, as the camera gives it. Against
another checkout both read the same frames by turns, each in a process of its own; what counts is the ratio.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from common.config import PoiSection
from common.environment import PROCESS_ENVIRONMENT
from deploy.bench.mission import HERE
from deploy.bench.order import Order
from offboard.evaluate.signs.fonts import DEVELOPMENT, HELD_OUT, missing
from offboard.evaluate.signs.photographs import missing as missing_photographs
from offboard.evaluate.signs.reading import evaluated
from offboard.evaluate.signs.scenes import Kind, case, drawable, store
from offboard.evaluate.signs.scoring import outcome_table, reliability_table
from onboard.poi.camera.frame_source import photo_files, read_photo
from onboard.poi.signs.grouping import signs
from onboard.poi.signs.ocr_engine import SignReader
from onboard.poi.signs.photo_reading import PHOTO_DETECTION_SIDE_PX
from onboard.poi.signs.sign_reading import sign_rules

CASES = {Kind.PLATE: 480, Kind.COVERED: 240, Kind.DISTRACTOR: 200, Kind.COMPOSITE: 240, Kind.PHOTOGRAPH: 560}
QUICK = 8  # one of so many cases
FRAMES, FRAMES_QUICK = 40, 12
MEMORY_MAX_MB = 450
# What both checkouts run: the engine over the photos of a folder; prints the seconds of processor time that it took
_TIMED = """
import importlib, importlib.util, sys, time
from pathlib import Path
import cv2
below = "onboard.poi.signs." if importlib.util.find_spec("onboard.poi.signs") else "onboard.poi."
modules = [below + name for name in ("ocr_engine", "sign_reading") if importlib.util.find_spec(below + name)]
reader = importlib.import_module(modules[0]).SignReader(640)
frames = [cv2.imread(str(file)) for file in sorted(Path(sys.argv[1]).iterdir())]
for frame in frames[:2]:
    reader.lines(frame)
began_s = time.process_time()
for frame in frames:
    reader.lines(frame)
print(time.process_time() - began_s)
"""


def bench(order: Order) -> None:
    if lacking := missing((*DEVELOPMENT, *HELD_OUT)):
        print(f"the signs need their fonts: pip install {' '.join(lacking)}")
        return
    if lacking := missing_photographs():
        print(f"photographs that are left out: pip install {' '.join(lacking)}")
    with tempfile.TemporaryDirectory(prefix="indoor-mapping-") as folder:
        for index in range(FRAMES_QUICK if order.quick else FRAMES):
            store(case(Kind.PLATE, index, DEVELOPMENT).image, Path(folder) / f"{index:03}.jpg")
        if order.against is not None:
            _by_turns(Path(folder), order.against.resolve(), order.pairs)
            return
        _run(HERE, "-m", "deploy.bench.sign_reading", "--frames", folder, capture=False)
    reader = SignReader(PHOTO_DETECTION_SIDE_PX)
    step = QUICK if order.quick else 1
    for name, fonts in (("fonts of development", DEVELOPMENT), ("fonts held out", HELD_OUT)):
        # Photographs without a sign are the same in both
        left_out = () if fonts is HELD_OUT else (Kind.PHOTOGRAPH,)
        kinds = [kind for kind in drawable() if kind not in left_out]
        cases = (case(kind, i, fonts) for kind in kinds for i in range(0, CASES[kind], step))
        results = list(evaluated(cases, reader))
        print(f"\n{name}", *outcome_table(results), "", *reliability_table(results), sep="\n", flush=True)


def frame_cost(folder: Path) -> None:
    """Prints what the stages of a full frame's reading take, in processor time, and the memory of this process."""
    reader, rules = SignReader(PHOTO_DETECTION_SIDE_PX), sign_rules(PoiSection())
    frames = [read_photo(file) for file in photo_files(folder)]
    reader.lines(frames[0])
    stages: dict[str, list[float]] = {"detection": [], "reading of the lines": [], "judgement": []}
    found = 0
    for frame in frames:
        marks = [time.process_time()]
        boxes = reader.boxes(frame)
        marks.append(time.process_time())
        lines = reader.read(frame, boxes)
        marks.append(time.process_time())
        for sign in signs(lines):
            rules.judge(sign)
        marks.append(time.process_time())
        found += len(lines)
        for durations, took in zip(stages.values(), np.diff(marks), strict=True):
            durations.append(1000 * float(took))
    print(f"a full frame, {len(frames)} frames with {found} lines of text, ms of processor time:")
    for stage, durations in (*stages.items(), ("all", [sum(each) for each in zip(*stages.values(), strict=True)])):
        print(f"  {stage:22} median {statistics.median(durations):7.1f}   largest {max(durations):7.1f}")
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"  resident memory at most {peak_mb:.0f} MB (of {MEMORY_MAX_MB}), {len(frames)} frames among it")


def _by_turns(folder: Path, other: Path, pairs: int) -> None:
    ratios = []
    for number in range(1, pairs + 1):
        took_s = {tree: float(_run(tree, "-c", _TIMED, str(folder))) for tree in (other, HERE)}
        ratios.append(took_s[other] / took_s[HERE])
        print(f"{number}: " + ", ".join(f"{tree} {s:.2f} s" for tree, s in took_s.items()), flush=True)
    low, high = min(ratios), max(ratios)
    print(f"the other takes {statistics.median(ratios):.2f} times as long, median of {pairs} ({low:.2f} to {high:.2f})")


def _run(tree: Path, *arguments: str, capture: bool = True) -> str:
    environment = os.environ | PROCESS_ENVIRONMENT | {"PYTHONPATH": str(tree)}
    command = [sys.executable, *arguments]
    return subprocess.run(
        command, check=True, cwd=tree, env=environment, stdout=subprocess.PIPE if capture else None, text=True
    ).stdout


def main() -> None:
    parser = argparse.ArgumentParser(prog="sign_reading", description="What the reading of a full frame costs.")
    parser.add_argument("--frames", type=Path, required=True, metavar="FOLDER")
    frame_cost(parser.parse_args().frames)


if __name__ == "__main__":
    main()
