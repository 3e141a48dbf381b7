"""What the terminal shows of the mission's state, on screens of every size, and what the keys do while it is busy."""

from __future__ import annotations

from pathlib import Path

import pytest
from textual import events
from textual.app import App
from textual.pilot import Pilot
from textual.widgets import Button, Input

from common.errors import ERRORS, ErrorCode
from common.messages.mission import Operation, Outcome
from offboard.command_center.app import CommandCenterApp
from offboard.command_center.log_book import LogFilter
from offboard.command_center.screens.guarded import Guarded
from tests.terminal.rig import SIZE, Rig, piloted, settle, shown
from tests.terminal.test_command_center_app import bar

SIZES = [(80, 24), (120, 40), (200, 60)]


def screen_lines(app: CommandCenterApp) -> list[str]:
    """Every line of the terminal, as a person reads it."""
    strips = app.screen._compositor.render_strips()
    return ["".join(segment.text for segment in strip).rstrip() for strip in strips]


def shows(app: CommandCenterApp, words: str, inside: str = "#robot, #trouble, .box") -> bool:
    """On the screen in front, in full, in one of these parts of it; also where a line is wrapped."""
    lines = screen_lines(app)
    for part in app.screen.query(inside):
        if not part.display:
            continue
        box = part.content_region
        seen = " ".join(line[box.x : box.right] for line in lines[box.y : box.bottom])
        if words in " ".join(seen.split()):
            return True
    return False


def burst(app: App[int], *keys: str) -> None:
    """Keys that come at once, before the program has looked at the first."""
    for key in keys:
        character = {"enter": "\r"}.get(key, key if len(key) == 1 else None)
        app.post_message(events.Key(key, character))


@pytest.mark.parametrize(
    ("mission", "text", "motion"),
    [
        ({}, "following the hall", "may move"),
        ({"paused": True}, "paused while following the hall", "stands still paused"),
        (
            {"mode": "DONE", "detail": "arrived at the place", "outcome": Outcome.ARRIVED},
            "arrived at the place",
            "stands still arrived at the place",
        ),
        (
            {"mode": "GOTO_BLOCKED", "detail": "no path to that place; waiting"},
            "no path to that place; waiting",
            "stands still no path to that place; waiting",
        ),
    ],
)
@piloted
async def test_the_robot_panel_shows_what_the_mission_does_and_whether_it_may_move(
    mission: dict[str, object], text: str, motion: str, tmp_path: Path
) -> None:
    rig = Rig()
    rig.mission = dict(mission)
    async with shown(rig, tmp_path) as (app, pilot):
        words = " ".join(app.main.robot.words.split())
        assert f"Mission {text} Motion {motion}" in words
        assert ("3 not visited" if mission.get("mode") == "DONE" else "3 to visit") in words
        rig.sources, rig.resumed = {"operator"}, False
        await settle(rig, app, pilot)
        assert "Mission stopped" in app.main.robot.words
        assert "stands still  stopped by operator" in app.main.robot.words


@piloted
async def test_a_question_that_is_open_when_a_stop_is_latched_promises_no_motion(tmp_path: Path) -> None:
    rig = Rig()
    rig.mission = {"paused": True}
    async with shown(rig, tmp_path) as (app, pilot):
        await pilot.press("r")
        assert shows(app, "The robot goes on where it was paused.")
        rig.sources, rig.resumed = {"button"}, False
        await settle(rig, app, pilot)
        assert not shows(app, "The robot goes on")
        assert shows(app, "The robot is stopped by button: release the stop first, then resume.")
        await pilot.press("enter")
        await settle(rig, app, pilot)
        assert rig.operations == []


@piloted
async def test_a_resume_with_nothing_paused_and_a_second_start_are_refused_before_the_question(tmp_path: Path) -> None:
    rig = Rig()
    async with shown(rig, tmp_path) as (app, pilot):
        await pilot.press("r", "s")
        assert app.screen is app.main
        told = [notification.message for notification in app._notifications]
        assert told == ["Nothing is paused.", "The mission is under way already; resume ends a pause."]
        rig.mission = {"mode": "WAITING", "detail": "waiting for start"}
        rig.sources, rig.resumed = {"operator"}, False
        await settle(rig, app, pilot)
        await pilot.press("s")
        assert shows(app, "But a stop is latched: nothing moves before its release and a resume.")


@pytest.mark.parametrize("size", SIZES)
@piloted
async def test_every_size_shows_mission_motion_position_and_the_address_of_the_map(
    size: tuple[int, int], tmp_path: Path
) -> None:
    rig = Rig()
    rig.speaking = (*rig.speaking, "visualizer")
    rig.mission = {"detail": "driving to a wall that the camera has not seen", "paused": True}
    async with shown(rig, tmp_path, size) as (app, _):
        assert shows(app, "paused while driving to a wall that the camera has not seen")
        assert shows(app, "stands still paused")
        assert shows(app, "x 3.20 y -1.05 m 90° ± 3 cm")
        assert shows(app, "http://127.0.0.1:8080/")
        assert "No stop is latched" in bar(app)
        assert all(shows(app, module, "#modules") for module in ("sim", "car", "mmu", "planner", "command center"))
        assert app.main.log_view.size.height >= 3


@pytest.mark.parametrize("size", SIZES)
@piloted
async def test_every_size_shows_an_error_with_all_of_its_words(size: tuple[int, int], tmp_path: Path) -> None:
    rig = Rig()
    rig.errors = {"recorder": ErrorCode.DATABASE_LOST, "comm": ErrorCode.STOP_RECORD}
    async with shown(rig, tmp_path, size) as (app, pilot):
        first = ERRORS[ErrorCode.STOP_RECORD]
        assert shows(app, f"comm: 704 {first.meaning} → {first.action} (1 more in the table)")
        app.main.modules.move_cursor(row=7)
        await settle(rig, app, pilot)
        marked = ERRORS[ErrorCode.DATABASE_LOST]
        assert shows(app, f"recorder: 803 {marked.meaning} → {marked.action}")
        assert app.main.log_view.size.height >= 1


@pytest.mark.parametrize("size", SIZES)
@piloted
async def test_every_size_shows_the_help_s_words_on_safety_in_full(size: tuple[int, int], tmp_path: Path) -> None:
    rig = Rig()
    async with shown(rig, tmp_path, size) as (app, pilot):
        await pilot.press("question_mark")
        await pilot.pause()
        assert shows(app, "The software stop is no emergency stop. It needs the link and the robot's own programs;")
        assert shows(app, "the red button on the robot needs neither. Stand so that you can reach that button.")
        await pilot.press("question_mark")
        assert app.screen is app.main


@piloted
async def test_a_wrong_word_releases_nothing_and_stays_told_until_it_is_changed(tmp_path: Path) -> None:
    rig = Rig()
    rig.sources, rig.resumed = {"operator"}, False
    async with shown(rig, tmp_path) as (app, pilot):
        await pilot.press("ctrl+r", *"yes", "enter")
        await settle(rig, app, pilot, 3.0)
        assert shows(app, "Nothing was released: the word is release.")
        assert rig.sources == {"operator"}
        await pilot.press("backspace")
        await settle(rig, app, pilot)
        assert not shows(app, "Nothing was released")


@piloted
async def test_keys_that_come_at_once_go_to_the_dialog_that_the_first_of_them_opens(tmp_path: Path) -> None:
    rig = Rig()
    rig.find_door("106", 7.0, 1.5)
    async with shown(rig, tmp_path) as (app, pilot):
        burst(app, "g", "1", "0", "6", "enter")
        await pilot.pause()
        await settle(rig, app, pilot)
        assert [command.operation for command in rig.operations[:1]] == [Operation.GOTO]
        burst(app, "slash", *"serpc")
        await pilot.pause()
        await settle(rig, app, pilot)
        assert app.main.search.value == "serpc"
        assert app.screen is app.main
        assert {command.operation for command in rig.operations} == {Operation.GOTO}
        burst(app, "escape", "t", "escape", "m", "M")
        await pilot.pause()
        assert app.screen is app.main


@piloted
async def test_keys_that_come_at_once_take_effect_in_their_order(tmp_path: Path) -> None:
    rig = Rig()
    rig.sources, rig.resumed = {"operator"}, False
    async with shown(rig, tmp_path) as (app, pilot):
        burst(app, "slash", "a", "b", "backspace", "c", "left", "d")
        await pilot.pause()
        assert app.main.search.value == "adc"
        burst(app, "escape")
        await pilot.pause()
        app.main.modules.focus()
        await pilot.pause()
        burst(app, "down", "down", "down", "m")
        await pilot.pause()
        assert app.main.filter.module == "mmu"
        burst(app, "ctrl+r", *"no", "backspace", "backspace", *"release", "enter")
        await pilot.pause()
        await settle(rig, app, pilot)
        assert rig.sources == set()


@piloted
async def test_the_confirmation_of_a_stop_is_shown_by_the_fast_timer_of_the_bar(tmp_path: Path) -> None:
    rig = Rig()
    async with shown(rig, tmp_path) as (app, pilot):
        await pilot.press("ctrl+e")
        assert "SENT – NOT CONFIRMED" in bar(app)
        rig.run(1.0)
        app._pull_bar_while_demanding()
        assert "LATCHED – robot confirmed in" in bar(app)


@piloted
async def test_a_burst_with_a_stop_in_it_stops(tmp_path: Path) -> None:
    rig = Rig()
    async with shown(rig, tmp_path) as (app, pilot):
        burst(app, "g", "1", "ctrl+e", "2")
        await pilot.pause()
        await settle(rig, app, pilot)
        assert rig.sources == {"operator"}
        assert isinstance(app.focused, Input)
        assert app.focused.value == "12"


@pytest.mark.parametrize(("row", "module"), [(0, "bridge"), (1, "bridge"), (3, "mmu"), (9, "command_center")])
@piloted
async def test_the_filter_by_module_is_by_whoever_logs_for_it(row: int, module: str, tmp_path: Path) -> None:
    rig = Rig()
    async with shown(rig, tmp_path) as (app, pilot):
        rig.log(module, "WARNING", "a line")
        await settle(rig, app, pilot)
        app.main.modules.move_cursor(row=row)
        await pilot.press("m")
        assert app.main.filter == LogFilter(module=module)
        assert [entry.message for entry in app.main.log_view.book.shown] == ["a line"]


@piloted
async def test_the_palette_runs_every_command_by_its_name(tmp_path: Path) -> None:
    rig = Rig()
    async with shown(rig, tmp_path) as (app, pilot):
        await pilot.press("ctrl+p", *"leve")
        await pilot.pause(0.5)
        await pilot.press("enter")
        await pilot.pause(0.5)
        assert app.main.filter.level == "WARNING"


async def open_modal(app: CommandCenterApp, pilot: Pilot[int]) -> None:
    await pilot.press("question_mark")


async def open_field(app: CommandCenterApp, pilot: Pilot[int]) -> None:
    await pilot.press("slash")
    assert isinstance(app.focused, Input)


async def open_choice(app: CommandCenterApp, pilot: Pilot[int]) -> None:
    await pilot.press("h")
    assert isinstance(app.focused, Button)


@pytest.mark.requirement("CC_MR_04")
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("place", [open_modal, open_field, open_choice])
@piloted
async def test_the_stop_works_at_every_size_over_everything_while_a_thousand_lines_a_second_come(
    place: object, size: tuple[int, int], tmp_path: Path
) -> None:
    rig = Rig()
    async with shown(rig, tmp_path, size) as (app, pilot):
        await place(app, pilot)  # type: ignore[operator]
        for second in range(2):
            for number in range(1000):
                rig.log("mmu", "INFO", f"line {second} {number}")
            await settle(rig, app, pilot, 0.2)
        burst(app, "ctrl+e")
        await pilot.pause()
        assert "SENT – NOT CONFIRMED" in bar(app)
        await settle(rig, app, pilot)
        assert "LATCHED – robot confirmed in" in bar(app)
        screen = app.screen
        assert isinstance(screen, Guarded)
        assert shows(app, "SOFTWARE STOP", "#stop-label")


@pytest.mark.parametrize("size", SIZES)
@piloted
async def test_a_link_that_is_down_shows_at_every_size(size: tuple[int, int], tmp_path: Path) -> None:
    rig = Rig()
    async with shown(rig, tmp_path, size) as (app, pilot):
        rig.silent = set(rig.speaking)
        await settle(rig, app, pilot, 6.0)
        assert "LINK LOST" in bar(app)
        assert shows(app, "LAST KNOWN, 6")
        assert shows(app, "Motion not received")
        await pilot.press("ctrl+e")
        await settle(rig, app, pilot, 1.0)
        assert "STOP NOT CONFIRMED 1.0 s" in bar(app)


@piloted
async def test_the_bell_rings_once_for_the_end_of_a_mission_and_for_a_robot_that_needs_help(tmp_path: Path) -> None:
    rig = Rig()
    app = rig.app(tmp_path)
    rung: list[float] = []
    app.bell = lambda: rung.append(rig.now_s)  # type: ignore[method-assign]
    async with app.run_test(size=SIZE) as pilot:
        await settle(rig, app, pilot)
        assert rung == []
        rig.errors["sim"] = ErrorCode.BATTERY_LOW
        await settle(rig, app, pilot)
        assert [n.message for n in app._notifications] == ["sim: the battery is low → charge the battery"]
        rig.errors.clear()
        await settle(rig, app, pilot)
        rig.errors["sim"] = ErrorCode.BATTERY_LOW
        await settle(rig, app, pilot)
        assert len(rung) == 1, "it was there a moment ago"
        rig.mission = {"mode": "DONE", "detail": "finished, and home", "outcome": Outcome.FINISHED}
        await settle(rig, app, pilot)
        await settle(rig, app, pilot)
        assert len(rung) == 2
    again = rig.app(tmp_path)
    again.bell = lambda: rung.append(rig.now_s)  # type: ignore[method-assign]
    async with again.run_test(size=SIZE) as pilot:
        await settle(rig, again, pilot)
        assert len(rung) == 2, "what was so before is no news"
