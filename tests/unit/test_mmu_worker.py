"""The back end beside the steps: in a process and deferred, one answer; and the map on disk."""

from __future__ import annotations

import time
from math import radians
from pathlib import Path

import numpy as np
import pytest

from common.geometry import Pose2
from common.side_process import ProcessWorker
from common.side_work import JobOutcome, WorkLost
from onboard.mmu.back_end.back_end_link import BackEndLink, BackEndWorker
from onboard.mmu.back_end.exchange import Correction, Increment
from onboard.mmu.back_end.map_builder import deferred_back_end
from onboard.mmu.map.keyframe_map import KeyframeMap
from onboard.mmu.map.keyframes import Keyframe, LastSeen
from onboard.mmu.map.map_file import SavedMap, load_map, save_map
from onboard.mmu.mmu import BACK_END

DEADLINE_S = 20.0


def increment(start: int = 0, count: int = 5) -> Increment:
    keyframes = tuple(
        Keyframe(i * 2.0, Pose2(0.4 * i, 0.0, 0.0), 0.4 * i, 0.4 * i, 0.0, 0.0) for i in range(start, start + count)
    )
    echoes = np.array(
        [[i, 0.4 * i, 0.1 * k, 1.0, radians(90.0), 1.0] for i in range(start, start + count) for k in range(4)]
    )
    return Increment(keyframes, echoes, np.zeros((0, 6)), LastSeen(7, Pose2(1.0, 2.0, 0.1), Pose2(1.6, 0.0, 0.0)))


def answer(worker: BackEndWorker) -> Correction | None:
    end_s = time.monotonic() + DEADLINE_S
    while time.monotonic() < end_s:
        outcome = worker.result(0.0)
        if outcome is not None:
            return outcome.value
        time.sleep(0.01)
    raise AssertionError(f"no answer within {DEADLINE_S:.0f} s")


def test_a_process_answers_like_the_deferred_back_end_and_saves_the_map(tmp_path: Path) -> None:
    deferred = deferred_back_end(latency_s=0.0)
    process: BackEndWorker = ProcessWorker("back end", BACK_END, str(tmp_path / "map.npz"))
    try:
        for start in (0, 5):
            for worker in (deferred, process):
                worker.begin(increment(start), 0.0)
            expected, found = answer(deferred), answer(process)
            assert expected is not None
            assert found is not None
            assert found.poses.tolist() == expected.poses.tolist()
    finally:
        process.close()
    saved = load_map(tmp_path / "map.npz")
    assert saved is not None
    assert len(saved.poses) == 5  # nothing closed and no 30 s passed since


class Lost:
    """A worker whose job was lost."""

    pending, busy, ready = 1, True, True

    def begin(self, job: Increment, now_s: float) -> None: ...

    def result(self, now_s: float) -> JobOutcome[Correction]:
        return JobOutcome(None, WorkLost("ended"))

    def due_s(self, now_s: float) -> float:
        return now_s

    def close(self) -> None: ...


def test_a_back_end_that_was_lost_is_to_be_given_everything_again() -> None:
    correction = BackEndLink(Lost(), KeyframeMap()).collect(0.0)
    assert correction is not None
    assert len(correction.poses) == 0


def test_a_saved_map_comes_back(tmp_path: Path) -> None:
    file = tmp_path / "map.npz"
    poses = np.array([[0.0, 0.0, 0.0], [0.4, 0.1, 0.2]])
    last = LastSeen(3, Pose2(5.0, 6.0, 0.5), Pose2(0.5, 0.1, 0.2))
    save_map(
        file,
        SavedMap(np.array([0.0, 2.0]), poses, np.array([0.0, 0.5]), increment(0, 1).echoes, np.zeros((0, 6)), last),
    )
    saved = load_map(file)
    assert saved is not None
    assert saved.poses == pytest.approx(poses)
    assert saved.last is not None
    assert saved.last.session == 3
    assert saved.last.board.as_array() == pytest.approx(last.board.as_array())
    assert saved.last.pose.as_array() == pytest.approx(last.pose.as_array())
    keyframes = saved.keyframes()
    assert keyframes[1].odom.heading_rad == pytest.approx(0.2)
    assert keyframes[1].travel_m == pytest.approx(np.hypot(0.4, 0.1))


@pytest.mark.parametrize("content", [b"", b"no map", None])
def test_a_map_that_cannot_be_read_begins_anew(tmp_path: Path, content: bytes | None) -> None:
    file = tmp_path / "map.npz"
    if content is not None:
        file.write_bytes(content)
    assert load_map(file) is None
