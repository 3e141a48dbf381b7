"""A recorded run in the terminal: the Command Center's screens at any of its moments; no key orders anything."""

from __future__ import annotations

import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import numpy as np
import pytest
from textual.pilot import Pilot

from common.bus import LocalMesh
from common.messages.health import LogLine, Status
from common.messages.mapping import MapUpdate, PoseEstimate
from common.messages.mission import PlannerView
from common.messages.points_of_interest import PointOfInterest
from common.messages.stop import Permit
from common.messages.topics import LOG, MAP, PERMIT, PLAN, POI, POSE, STATUS
from offboard.command_center.replay_app import ReplayApp
from offboard.command_center.run_player import RunPlayer
from offboard.command_center.screens.replay import moment_of
from offboard.recorder.recorder import Recorder
from onboard.comm.outbox import Outbox
from tests.terminal.rig import piloted
from tests.terminal.test_states_and_keys import SIZES, screen_lines

DURATION_S = 60.0
STOPPED_S = 30.0


def record(folder: Path) -> None:
    """A minute: the robot drives a metre every ten seconds, finds a door at 20 s, is stopped at 30 s."""
    mesh = LocalMesh()
    robot, bus, comm = mesh.endpoint("robot"), mesh.endpoint("recorder"), mesh.endpoint("comm")
    recorder, outbox = Recorder(folder), Outbox(None, 1_000_000_000, new_id=1)
    recorder.step(bus, 0.0), outbox.step(comm, 0.0)
    for tick in range(round(DURATION_S / 0.1) + 1):
        mesh.now_s = now_s = round(0.1 * tick, 3)
        held = now_s >= STOPPED_S
        robot.publish(POSE, PoseEstimate(now_s, now_s / 10, 0.0, 0.0, 0.0, 0.03, 0.01, 1))
        robot.publish(STATUS["mmu"], Status(now_s, "MAPPING", 0, 51_200, True, tick))
        sources = ("operator",) if held else ()
        robot.publish(PERMIT, Permit(now_s, not held, "stopped by operator" if held else "", sources, stop_epoch=1))
        if tick % 5 == 0:
            doing = "driving to a side hall" if now_s >= 10.0 else "following the hall"
            robot.publish(PLAN, PlannerView(now_s, "STRAIGHT", doing, np.empty((0, 2), np.float32), 2, now_s))
            points = np.array([[now_s / 10, 1.0]], np.float32)
            robot.publish(MAP, MapUpdate(now_s, 1, tick // 5, points, np.zeros(1, np.uint8)))
        if tick % 100 == 0:
            robot.publish(LOG["mmu"], LogLine(now_s, "INFO", f"line at {now_s:.0f} s"))
        if tick == 200:
            robot.publish(POI, PointOfInterest(now_s, 1, "Door", "106", 2.0, 1.0, "106", "Office", 0.9, "read"))
        if tick == 400:
            robot.publish(LOG["comm"], LogLine(now_s, "WARNING", "the link is slow"))
        outbox.step(comm, now_s)
        recorder.step(bus, now_s)
    for _ in range(12):
        mesh.now_s += 0.05
        outbox.step(comm, mesh.now_s)
        recorder.step(bus, mesh.now_s)
    recorder._draw = lambda _: None
    recorder.close()


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    record(folder)
    return folder


class Passing:
    """The time that passes for who looks."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@asynccontextmanager
async def opened(
    run: Path, folder: Path, size: tuple[int, int] = (150, 40)
) -> AsyncIterator[tuple[ReplayApp, Pilot[int], Passing]]:
    player, passing = RunPlayer(run), Passing()
    app = ReplayApp(player, "loop", folder, passing)
    try:
        async with app.run_test(size=size) as pilot:
            app.pull()
            await pilot.pause()
            yield app, pilot, passing
    finally:
        player.close()


async def after(seconds: float, app: ReplayApp, pilot: Pilot[int], passing: Passing) -> None:
    passing.now_s += seconds
    app.pull()
    await pilot.pause()


def bar(app: ReplayApp) -> str:
    return str(app.main.stop_bar.query_one("#stop-text").render())


@piloted
async def test_it_opens_at_the_end_with_the_words_of_the_live_screen(run: Path, tmp_path: Path) -> None:
    async with opened(run, tmp_path) as (app, _, _):
        words = app.main.robot.words
        assert "stopped while driving to a side hall" in words
        assert "x 6.00" in words
        assert "LATCHED" in bar(app)
        assert app.main.modules.get_cell("mmu", "age").plain == "● live"
        assert app.main.modules.get_cell("mmu", "rate").plain == "10 Hz"
        assert "1 door found" in words


@piloted
async def test_a_jump_shows_that_moment_and_nothing_that_came_later(run: Path, tmp_path: Path) -> None:
    async with opened(run, tmp_path) as (app, pilot, _):
        await pilot.press("g", *"0:15", "enter")
        await pilot.pause()
        words = app.main.robot.words
        assert "x 1.4" in words
        assert "driving to a side hall" in words
        assert "0 doors found" in words
        assert "No stop was latched" in bar(app)
        assert 29 <= len(app.node.floor_picture().walls_m) <= 31
        await pilot.press("less_than_sign")
        assert "following the hall" in app.main.robot.words
        await pilot.press("g", *"9:99", "enter")
        assert "A moment is a time up to 0:01:0" in str(app.screen.query_one(".warning").render())


@piloted
async def test_it_plays_pauses_and_plays_faster_in_the_runs_own_time(run: Path, tmp_path: Path) -> None:
    async with opened(run, tmp_path) as (app, pilot, passing):
        await pilot.press("space")
        await after(5.0, app, pilot, passing)
        assert app.player.at_s == pytest.approx(5.0)
        assert "x 0.4" in app.main.robot.words
        await pilot.press("plus", "plus")
        await after(5.0, app, pilot, passing)
        assert app.player.at_s == pytest.approx(25.0)
        assert app.main.modules.get_cell("mmu", "rate").plain == "10 Hz"
        await pilot.press("space")
        await after(5.0, app, pilot, passing)
        assert app.player.at_s == pytest.approx(25.0)
        await pilot.press("space")
        await after(500.0, app, pilot, passing)
        assert app.player.at_s == app.player.duration_s
        assert "standing" in app.corner


@piloted
async def test_from_a_log_line_to_its_moment_and_the_log_stays_whole(run: Path, tmp_path: Path) -> None:
    async with opened(run, tmp_path) as (app, pilot, _):
        view = app.main.log_view
        whole = [entry.message for entry in view.book.shown]
        assert "line at 0 s" in whole
        assert "line at 60 s" in whole
        await pilot.press("slash", *"link is slow", "enter", "up", "enter")
        await pilot.pause()
        assert app.player.at_s == pytest.approx(40.0, abs=0.2)
        assert "x 4.0" in app.main.robot.words
        await pilot.press("x")
        assert [entry.message for entry in view.book.shown] == whole


@piloted
async def test_the_moments_of_the_run_are_a_key_away_and_on_the_timeline(run: Path, tmp_path: Path) -> None:
    async with opened(run, tmp_path) as (app, pilot, _):
        found = []
        for _ in range(4):
            await pilot.press("b")
            found.append(str(app.main.timeline.render()).splitlines()[-1].split(" ", 1)[-1].strip())
        assert found[0] == "log comm: the link is slow"
        assert found[1] == "door Door 106"
        assert found[2] == "mission driving to a side hall"
        assert str(app.main.timeline.render()).count("┿") >= 3
        width = app.main.timeline.content_size.width
        await pilot.click("#timeline", offset=(1 + width // 2, 0))
        assert app.player.at_s == pytest.approx(app.player.duration_s / 2, abs=1.0)


@piloted
async def test_messages_of_chosen_topics_stand_among_the_lines_of_the_whole_run(run: Path, tmp_path: Path) -> None:
    async with opened(run, tmp_path) as (app, pilot, _):
        app.show_messages(frozenset({"mmu/pose"}))
        app.main.set_topics(frozenset({"mmu/pose"}))
        await pilot.pause()
        entries = app.main.log_view.book.shown
        assert sum(entry.is_message for entry in entries) == round(DURATION_S / 0.1) + 1
        assert [entry.arrived_s for entry in entries] == sorted(entry.arrived_s for entry in entries)


@piloted
async def test_no_key_of_the_live_screen_orders_anything(run: Path, tmp_path: Path) -> None:
    async with opened(run, tmp_path) as (app, pilot, _):
        await pilot.press("ctrl+e", "f12", "ctrl+r", "s", "p", "r", "h")
        await pilot.click("#stop-label")
        await pilot.pause()
        assert app.screen is app.main
        assert app.node.stop_desk.control.since_s == 0.0
        assert app.node.snapshot().operation is None
        assert app.player.playing, "a click on the bar plays"


@piloted
async def test_a_database_that_turns_out_to_be_damaged_ends_it_with_one_sentence(run: Path, tmp_path: Path) -> None:
    """Where a message lies is known; what it holds is read when it is shown."""
    damaged = Path(shutil.copytree(run, tmp_path / "damaged"))
    async with opened(damaged, tmp_path) as (app, pilot, _):
        app.player._reader._database.close()
        await pilot.press("less_than_sign")
        await pilot.pause()
        assert app.return_code == 2
        assert not app.is_running


@pytest.mark.parametrize("size", SIZES, ids="{0[0]}x{0[1]}".format)
@piloted
async def test_every_size_shows_moment_mission_timeline_and_log(
    size: tuple[int, int], run: Path, tmp_path: Path
) -> None:
    async with opened(run, tmp_path, size) as (app, _, _):
        seen = "\n".join(screen_lines(app))
        for words in ("RECORDED RUN", "0:01:0", "stopped while driving to a side hall", "█", "line at"):
            assert words in seen, words


@pytest.mark.parametrize(
    ("text", "at_s"),
    [("192", 192.0), ("3:12", 192.0), (" 0:03:12.5 ", 192.5), ("", None), ("3:", None), ("soon", None)],
)
def test_a_moment_is_written_as_people_do(text: str, at_s: float | None) -> None:
    assert moment_of(text) == at_s
