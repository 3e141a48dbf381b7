"""The back end beside the steps: two ways to run it, one answer; and the map on disk."""

from __future__ import annotations

import time
from math import radians
from pathlib import Path

import numpy as np
import pytest

from common.geometry import Pose2
from onboard.mmu.back_end.deferred_worker import DeferredWorker
from onboard.mmu.back_end.exchange import Correction, Increment
from onboard.mmu.back_end.worker import ProcessWorker
from onboard.mmu.map.keyframes import Keyframe, LastSeen
from onboard.mmu.map.map_file import SavedMap, load_map, save_map

DEADLINE_S = 20.0


def increment(start: int = 0, count: int = 5) -> Increment:
    keyframes = tuple(
        Keyframe(i * 2.0, Pose2(0.4 * i, 0.0, 0.0), 0.4 * i, 0.4 * i, 0.0, 0.0) for i in range(start, start + count)
    )
    echoes = np.array(
        [[i, 0.4 * i, 0.1 * k, 1.0, radians(90.0), 1.0] for i in range(start, start + count) for k in range(4)]
    )
    return Increment(keyframes, echoes, np.zeros((0, 6)), LastSeen(7, Pose2(1.0, 2.0, 0.1), Pose2(1.6, 0.0, 0.0)))


def test_the_answer_of_a_deferred_worker_comes_after_a_fixed_time() -> None:
    worker = DeferredWorker(latency_s=0.4)
    assert not worker.busy
    worker.submit(increment(), 10.0)
    worker.work()
    assert worker.busy
    assert worker.collect(10.3) is None
    correction = worker.collect(10.4)
    assert correction is not None
    assert correction.poses[:, 0] == pytest.approx([0.0, 0.4, 0.8, 1.2, 1.6])
    assert not worker.busy


def answer(worker: ProcessWorker) -> Correction:
    end_s = time.monotonic() + DEADLINE_S
    while time.monotonic() < end_s:
        correction = worker.collect(0.0)
        if correction is not None:
            return correction
        time.sleep(0.01)
    raise AssertionError(f"no answer within {DEADLINE_S:.0f} s")


def test_a_process_answers_like_the_deferred_worker_and_saves_the_map(tmp_path: Path) -> None:
    deferred, process = DeferredWorker(latency_s=0.0), ProcessWorker(tmp_path / "map.npz")
    try:
        for start in (0, 5):
            deferred.submit(increment(start), 0.0)
            process.submit(increment(start), 0.0)
            expected = deferred.collect(0.0)
            assert expected is not None
            assert answer(process).poses.tolist() == expected.poses.tolist()
    finally:
        process.close()
    saved = load_map(tmp_path / "map.npz")
    assert saved is not None
    assert len(saved.poses) == 5  # nothing closed and no 30 s passed since


def test_a_process_that_dies_is_replaced_and_asks_for_everything() -> None:
    worker = ProcessWorker()
    try:
        worker._process.kill()
        worker.submit(increment(), 0.0)
        assert len(answer(worker).poses) == 0
        worker.submit(increment(), 0.0)
        assert len(answer(worker).poses) == 5
    finally:
        worker.close()


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
