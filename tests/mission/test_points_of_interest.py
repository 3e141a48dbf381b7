"""The robot with its camera, in lockstep: what it finds on a wall, and that it finds the same again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from common.messages.mapping import PoseEstimate
from common.messages.points_of_interest import PointOfInterest
from common.messages.topics import POI, POSE
from tests.mission.story import Story

SECONDS = 95.0  # past door and poster

Tell = Callable[..., Story]


def found(story: Story, seconds: float) -> tuple[dict[int, PointOfInterest], PoseEstimate | None]:
    """The records after so much driving, and where it ended."""
    if story.robot.simulation.camera is None:
        pytest.skip("no OpenGL library: apt install libegl1 libopengl0 libgl1-mesa-dri")
    pytest.importorskip("rapidocr")
    operator = story.robot.operator
    operator.take(POI)
    records: dict[int, PointOfInterest] = {}

    def listen() -> None:
        records.update({record.poi_id: record for record in operator.take(POI)})

    story.start()
    story.run(seconds, listen)
    return records, operator.latest(POSE)


@pytest.mark.requirement("POI_MR_01", "POI_MR_02", "POI_MR_03", "POI_MR_04")
def test_robot_reads_a_plate_in_passing_and_leaves_the_poster(tell: Tell, hall_with_door: Path) -> None:
    records, _ = found(tell(hall_with_door, seed=1, camera="realistic"), SECONDS)
    assert [(r.name, r.number, r.room_type, r.state) for r in records.values()] == [("Door", "215B", "Office", "read")]
    (door,) = records.values()
    # The map begins at the start, one metre from the end of the hall and in its middle
    assert (door.x_m, door.y_m) == pytest.approx((3.0, -0.8), abs=0.15)
    assert door.photo_jpeg


@pytest.mark.slow
def test_run_with_a_camera_repeats_to_the_bit(tell: Tell, hall_with_door: Path) -> None:
    records, pose = found(tell(hall_with_door, seed=1, camera="realistic"), SECONDS)
    again, pose_again = found(tell(hall_with_door, seed=1, camera="realistic"), SECONDS)
    assert records
    assert again == records
    assert pose_again == pose
