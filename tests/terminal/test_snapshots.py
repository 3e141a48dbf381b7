"""The screens as a person sees them, word by word, at three sizes: files in `snapshots/`, one per screen and size.

After a change that is meant run `UPDATE_SNAPSHOTS=1 .venv/bin/python -m pytest tests/terminal/test_snapshots.py`, then
look at what git shows. Clock and messages are the rig's, so that nothing differs between two runs but the time of day.
"""

from __future__ import annotations

import os
import re
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
from textual.pilot import Pilot

from common.errors import ErrorCode
from offboard.command_center.app import CommandCenterApp
from tests.terminal.rig import Rig, piloted, settle
from tests.terminal.test_states_and_keys import SIZES, screen_lines

FOLDER = Path(__file__).with_name("snapshots")
_CLOCK = re.compile(r"\d\d:\d[\d:]*")  # under the edge of a dialog it is cut short


async def driving(rig: Rig, app: CommandCenterApp, pilot: Pilot[int]) -> None:
    """Nothing is open."""


async def paused_and_in_trouble(rig: Rig, app: CommandCenterApp, pilot: Pilot[int]) -> None:
    rig.mission = {"paused": True, "mode": "IMAGE", "detail": "driving to a wall that the camera has not seen"}
    rig.errors = {"recorder": ErrorCode.DATABASE_LOST}


async def stopped(rig: Rig, app: CommandCenterApp, pilot: Pilot[int]) -> None:
    await pilot.press("ctrl+e")
    await settle(rig, app, pilot)
    await pilot.press("ctrl+r", *"halt", "enter")


async def helped(rig: Rig, app: CommandCenterApp, pilot: Pilot[int]) -> None:
    await pilot.press("question_mark")


async def leaving(rig: Rig, app: CommandCenterApp, pilot: Pilot[int]) -> None:
    await pilot.press("q")


Scene = Callable[[Rig, CommandCenterApp, Pilot[int]], Awaitable[None]]
SCENES: list[Scene] = [driving, paused_and_in_trouble, stopped, helped, leaving]


@pytest.mark.parametrize("size", SIZES, ids="{0[0]}x{0[1]}".format)
@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.__name__)
@piloted
async def test_the_screen_is_as_it_was(scene: Scene, size: tuple[int, int], tmp_path: Path) -> None:
    rig = Rig()
    rig.speaking = (*rig.speaking, "visualizer", "command_center")
    rig.draw_wall()
    rig.find_door("106", 7.0, 1.5)
    app = rig.app(tmp_path, owns_mesh=True)
    async with app.run_test(size=size) as pilot:
        rig.log("mmu", "INFO", "loop closed")
        rig.log("planner", "WARNING", "obstacle place=3.10,0.20")
        await settle(rig, app, pilot)
        await scene(rig, app, pilot)
        await settle(rig, app, pilot)
        app.main.show_floor(rig.node.floor_picture())
        await pilot.pause()
        screen = "\n".join(screen_lines(app)) + "\n"
        seen = _CLOCK.sub(lambda clock: "HH:MM:SS"[: len(clock[0])], screen)
    file = FOLDER / f"{scene.__name__}_{size[0]}x{size[1]}.txt"
    if os.environ.get("UPDATE_SNAPSHOTS"):
        FOLDER.mkdir(exist_ok=True)
        file.write_text(seen, encoding="utf-8")
    assert seen == file.read_text(encoding="utf-8")
