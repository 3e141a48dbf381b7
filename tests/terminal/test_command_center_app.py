"""The terminal UI through its pilot: what it shows, and that the stop works wherever one is."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from math import nan
from pathlib import Path

import pytest
from textual.content import Content
from textual.pilot import Pilot
from textual.widgets import Input

from common.errors import ERRORS, ErrorCode
from common.messages.health import BoardState
from common.messages.mission import Operation
from common.messages.points_of_interest import PointOfInterest
from common.messages.topics import PERMIT, POI
from common.modules import MODULES, OPTIONAL
from offboard.command_center.actions import END_MESH, KEEP_MESH
from offboard.command_center.app import CommandCenterApp
from offboard.command_center.screens.guarded import Guarded
from offboard.operate.software_stop import Look
from tests.terminal.rig import EPOCH_S, SIZE, Rig, piloted, settle, shown


def cell(app: CommandCenterApp, module: str, column: str) -> str:
    return app.main.modules.get_cell(module, column).plain


def bar(app: CommandCenterApp) -> str:
    """The words of the bar of the screen in front, which must be on its very top."""
    screen = app.screen
    assert isinstance(screen, Guarded)
    assert screen.stop_bar.region.y == 0
    assert screen.stop_bar.region.width == app.size.width
    return str(screen.stop_bar.query_one("#stop-text").render())


@pytest.mark.requirement("CC_MR_03")
@piloted
async def test_a_row_per_module_shows_state_error_with_meaning_and_action_memory_rate_and_age(tmp_path: Path) -> None:
    rig = Rig()
    rig.errors["planner"] = ErrorCode.BLOCKED
    app = rig.app(tmp_path)
    async with app.run_test(size=SIZE) as pilot:
        await settle(rig, app, pilot, 3.0)
        assert {module.name for module in MODULES} - OPTIONAL == {row.module for row in rig.node.snapshot().rows}
        assert app.main.modules.row_count == 10
        assert cell(app, "sim", "state") == "RUN"
        assert cell(app, "sim", "memory") == "50 MB"
        assert cell(app, "sim", "rate") == "10 Hz"
        assert cell(app, "sim", "age") == "● live"
        blocked = ERRORS[ErrorCode.BLOCKED]
        assert cell(app, "planner", "error") == f"503 {blocked.meaning} → {blocked.action}"
        assert cell(app, "poi", "age") == "no message"
        rig.speaking = (*rig.speaking, "ros")
        await settle(rig, app, pilot, 3.0)
        assert cell(app, "ros", "age") == "● live", "an optional one has its row once it runs"


@piloted
async def test_a_line_per_board_shows_release_uptime_load_heat_disk_and_how_far_off_its_clock_is(
    tmp_path: Path,
) -> None:
    rig = Rig()
    async with shown(rig, tmp_path) as (app, pilot):
        assert not app.main.boards.display
        beaglebone = BoardState(0.0, "beaglebone", "2026-11-22", 90_000.0, 0.42, nan, 1_234, EPOCH_S + rig.now_s - 60.0)
        raspberry = BoardState(0.0, "raspberry", "sources", 59.0, 3.5, 85.0, 150, EPOCH_S + rig.now_s)
        rig.report_board("comm", beaglebone)
        rig.report_board("poi", raspberry)
        await settle(rig, app, pilot)
        first, second = (" ".join(line.split()) for line in str(app.main.boards.render()).splitlines())
        for words in ("beaglebone", "2026-11-22", "up 1 d 1 h", "load 0.42", "heat –", "free 1.2", "clock -60.0 s"):
            assert words in first
        for words in ("raspberry", "sources", "up 59.0 s", "heat 85 °C", "clock +0.0 s"):
            assert words in second
        assert "ago" not in first + second
        await settle(rig, app, pilot, 20.0)
        assert "as of 21.0 s ago" in str(app.main.boards.render())


@piloted
async def test_what_is_old_is_marked_and_never_shown_as_live(tmp_path: Path) -> None:
    rig = Rig()
    async with shown(rig, tmp_path) as (app, pilot):
        assert "LAST KNOWN" not in app.main.robot.words
        rig.silent = {"mmu", "bridge"}
        await settle(rig, app, pilot, 2.0)
        assert cell(app, "mmu", "age").startswith("STALE 2")
        position = app.main.robot.words
        assert "x 3.20  y -1.05 m" in position
        assert "LAST KNOWN, 2" in position
        assert "wheel speed unknown" in bar(app)
        rig.silent |= {"comm"}
        await settle(rig, app, pilot, 5.0)
        assert cell(app, "mmu", "age").startswith("GONE 7")
        assert "LINK LOST" in bar(app)
        rig.silent = set()
        await settle(rig, app, pilot)
        assert cell(app, "mmu", "age") == "● live"
        assert "No stop is latched" in bar(app)


async def open_nothing(app: CommandCenterApp, pilot: Pilot[int]) -> None:
    await pilot.pause()


async def open_search(app: CommandCenterApp, pilot: Pilot[int]) -> None:
    await pilot.press("slash")
    assert isinstance(app.focused, Input)


async def open_goto(app: CommandCenterApp, pilot: Pilot[int]) -> None:
    await pilot.press("g")
    assert isinstance(app.focused, Input)


async def open_question(app: CommandCenterApp, pilot: Pilot[int]) -> None:
    await pilot.press("s")


async def open_topics(app: CommandCenterApp, pilot: Pilot[int]) -> None:
    await pilot.press("t")


async def open_help(app: CommandCenterApp, pilot: Pilot[int]) -> None:
    await pilot.press("question_mark")


async def open_palette(app: CommandCenterApp, pilot: Pilot[int]) -> None:
    await pilot.press("ctrl+p")
    assert isinstance(app.focused, Input)


Opener = Callable[[CommandCenterApp, Pilot[int]], Awaitable[None]]
PLACES: list[Opener] = [open_nothing, open_search, open_goto, open_question, open_topics, open_help, open_palette]
TYPING: tuple[Opener, ...] = (open_search, open_goto, open_palette)


@pytest.mark.requirement("CC_MR_04")
@pytest.mark.parametrize("place", PLACES)
@piloted
async def test_the_stop_works_from_everywhere_and_shows_the_robots_confirmation(place: Opener, tmp_path: Path) -> None:
    rig = Rig()
    async with shown(rig, tmp_path) as (app, pilot):
        await place(app, pilot)
        await pilot.pause()
        screen = app.screen
        for key in ("ctrl+e", "f12", "click") if place in TYPING else ("ctrl+e", "f12", "click", "space"):
            if key == "click":
                await pilot.click(offset=(8, 1))
            else:
                await pilot.press(key)
            assert "SENT – NOT CONFIRMED" in bar(app), key
            await settle(rig, app, pilot)
            assert app.screen is screen, "the stop must not close what is open"
            assert rig.sources == {"operator"}
            assert "LATCHED – robot confirmed in" in bar(app)
            assert "speed 0.00" in bar(app)
            assert rig.node.stop_desk.control.latency_s == pytest.approx(0.3, abs=0.11)
            rig.sources.clear()
            await settle(rig, app, pilot)
            assert "No stop is latched" in bar(app)


@piloted
async def test_space_in_a_field_writes_a_space_and_stops_nothing(tmp_path: Path) -> None:
    rig = Rig()
    app = rig.app(tmp_path)
    async with app.run_test(size=SIZE) as pilot:
        await pilot.press("slash", "a", "space", "b")
        await settle(rig, app, pilot)
        assert app.main.search.value == "a b"
        assert rig.stops == []


@piloted
async def test_a_stop_that_nobody_confirms_says_so_and_is_sent_on_and_on(tmp_path: Path) -> None:
    rig = Rig()
    rig.deaf = True
    async with shown(rig, tmp_path) as (app, pilot):
        await pilot.press("ctrl+e")
        await settle(rig, app, pilot, 2.0)
        assert "SENT – NOT CONFIRMED 2.0 s" in bar(app)
        assert "red button on the robot" in bar(app)
        assert len(rig.stops) == pytest.approx(40, abs=2)
        rig.silent = {"comm"}
        await settle(rig, app, pilot, 2.0)
        assert "LINK LOST · STOP NOT CONFIRMED 4.0 s" in bar(app)
        rig.silent, rig.deaf = set(), False
        await settle(rig, app, pilot)
        assert "LATCHED" in bar(app)


@pytest.mark.requirement("CC_MR_04")
@piloted
async def test_the_release_takes_the_typed_word_and_starts_nothing(tmp_path: Path) -> None:
    rig = Rig()
    async with shown(rig, tmp_path) as (app, pilot):
        await pilot.press("ctrl+e")
        await settle(rig, app, pilot)
        await pilot.press("ctrl+r", *"yes", "enter")
        await settle(rig, app, pilot)
        assert rig.sources == {"operator"}
        for _ in range(3):
            await pilot.press("backspace")
        await pilot.press(*"release", "enter")
        await settle(rig, app, pilot)
        assert rig.sources == set()
        assert rig.operations == []
        assert rig.node.snapshot().look is Look.IDLE


@piloted
async def test_no_release_while_the_button_is_pressed_or_the_link_is_lost(tmp_path: Path) -> None:
    rig = Rig()
    app = rig.app(tmp_path)
    async with app.run_test(size=SIZE) as pilot:
        rig.sources, rig.button_pressed = {"operator", "button"}, True
        await settle(rig, app, pilot)
        await pilot.press("ctrl+r")
        assert app.screen is app.main, "not even asked"
        assert "held by button, operator" in bar(app)
        rig.button_pressed = False
        await settle(rig, app, pilot)
        await pilot.press("ctrl+r", *"release")
        rig.silent = {"comm"}
        await settle(rig, app, pilot, 2.0)
        await pilot.press("enter")
        await settle(rig, app, pilot)
        assert rig.sources == {"button", "operator"}


@piloted
async def test_a_resume_of_a_latched_stop_promises_nothing(tmp_path: Path) -> None:
    rig = Rig()
    app = rig.app(tmp_path)
    async with app.run_test(size=SIZE) as pilot:
        rig.sources = {"button"}
        await settle(rig, app, pilot)
        await pilot.press("r")
        assert app.screen is app.main, "not even asked"
        await settle(rig, app, pilot)
        assert rig.operations == []


@pytest.mark.parametrize(
    ("keys", "operation"),
    [
        (("s", "enter"), Operation.START),
        (("S", "enter"), Operation.START),
        (("p",), Operation.PAUSE),
        (("r", "enter"), Operation.RESUME),
        (("R", "enter"), Operation.RESUME),
        (("h", "enter"), Operation.HOME),
        (("g", *"214", "enter"), Operation.GOTO),
        (("z", *"line", "space", *"3,-1", "space", *"3,1", "enter"), Operation.NO_GO_LINE),
    ],
)
@piloted
async def test_operations_are_asked_for_where_they_move_the_robot_and_repeated_until_taken(
    keys: tuple[str, ...], operation: Operation, tmp_path: Path
) -> None:
    rig = Rig()
    rig.find_door("214", 7.0, 1.5)
    rig.mission = {"mode": "WAITING"} if operation is Operation.START else {"paused": True}
    rig.run(0.5)
    rig.silent = {"planner"}
    async with shown(rig, tmp_path) as (app, pilot):
        for key in keys:
            assert rig.node.snapshot().operation is None, "nothing before the last key"
            await pilot.press(key)
        await settle(rig, app, pilot)
        assert len(rig.operations) > 5
        rig.silent = set()
        await settle(rig, app, pilot)
        assert {command.operation for command in rig.operations} == {operation}
        assert len({command.command_id for command in rig.operations}) == 1
        if operation is Operation.GOTO:
            assert (rig.operations[0].x_m, rig.operations[0].y_m) == (7.0, 1.5)
        if operation is Operation.NO_GO_LINE:
            assert rig.operations[0].corners_x_m == (3.0, 3.0)
            assert rig.operations[0].corners_y_m == (-1.0, 1.0)
        result = rig.node.snapshot().operation
        assert result is not None
        assert result.sentence == f"The planner took the {operation.value}."


@piloted
async def test_an_operation_that_nobody_takes_is_told_in_one_sentence(tmp_path: Path) -> None:
    rig = Rig()
    rig.silent = {"planner"}
    app = rig.app(tmp_path)
    async with app.run_test(size=SIZE) as pilot:
        await pilot.press("p")
        await settle(rig, app, pilot, 4.0)
        result = rig.node.snapshot().operation
        assert result is not None
        assert result.sentence == "Nobody answered the pause: is the planner running?"
        assert [n.message for n in app._notifications] == [result.sentence]


@piloted
async def test_the_filter_shows_in_the_title_with_the_share_that_passes(tmp_path: Path) -> None:
    rig = Rig()
    async with shown(rig, tmp_path) as (app, pilot):
        rig.log("mmu", "INFO", "loop closed")
        rig.log("mmu", "WARNING", "loop refused")
        rig.log("planner", "INFO", "state=STRAIGHT")
        await settle(rig, app, pilot)
        view = app.main.log_view
        assert len(view.book.shown) == view.book.total
        await pilot.press("slash", *"LOOP", "enter")
        assert [entry.message for entry in view.book.shown] == ["loop closed", "loop refused"]
        assert f"LOG 2/{view.book.total} · info and above · /LOOP/" in str(view.border_title)
        await pilot.press("l")
        assert [entry.message for entry in view.book.shown] == ["loop refused"]
        assert view.book.shown[0].text.startswith("MMU_CC_")
        assert view.book.shown[0].text.endswith("_WARNING,loop refused")
        await pilot.press("slash", *"(", "enter")
        assert "no regular expression" in str(view.border_subtitle)
        await pilot.press("x")
        assert len(view.book.shown) == view.book.total


HOSTILE = "[/a] [bold red]x[@click=app.bell] \\[ \x1b]0;t\x07\x1b[2J\x9b31m two\nlines \u202eturned"
CLEANED = "[/a] [bold red]x[@click=app.bell] \\[ \ufffd]0;t\ufffd\ufffd[2J\ufffd31m two lines \ufffdturned"


@piloted
async def test_words_from_outside_are_never_markup_nor_reach_the_terminal_as_control_characters(tmp_path: Path) -> None:
    rig = Rig()
    rig.words, rig.sources = HOSTILE, {HOSTILE, "operator"}
    rig.log("mmu", HOSTILE, HOSTILE)
    rig.robot.publish(POI, PointOfInterest(0.0, 1, HOSTILE, HOSTILE, 1.0, 1.0, HOSTILE, HOSTILE, 0.5, HOSTILE))
    rig.node.show_messages(frozenset({PERMIT.key, POI.key}))
    app = rig.app(tmp_path)
    async with app.run_test(size=SIZE) as pilot:
        app.main.set_topics(frozenset({PERMIT.key, POI.key}))
        await settle(rig, app, pilot)
        assert CLEANED in bar(app)
        assert cell(app, "mmu", "state") == CLEANED
        assert f"stands still  {CLEANED}" in app.main.robot.words
        texts = [entry.text for entry in app.main.log_view.book.shown]
        assert any(text.endswith(f"_{CLEANED},{CLEANED}") for text in texts)
        assert all(text.isprintable() for text in texts)
        await pilot.press("p")
        await settle(rig, app, pilot)
        assert any(f"stands: {CLEANED}" in notification.message for notification in app._notifications)
        await pilot.press("g", *"[/a],", "enter")
        assert "[/a]," in str(app.screen.query_one(".warning").render())


@pytest.mark.parametrize("pattern", ["[/a]", "[", "a{99999999999}", "(" * 2000 + ")" * 2000, "[bold]x"])
@piloted
async def test_search_takes_whatever_is_typed_and_shows_it_as_it_is(pattern: str, tmp_path: Path) -> None:
    rig = Rig()
    app = rig.app(tmp_path)
    async with app.run_test(size=SIZE) as pilot:
        await pilot.press("slash")
        app.main.search.value = pattern
        await settle(rig, app, pilot)
        shown = Content.from_markup(app.main.log_view.border_title or "").plain
        said = Content.from_markup(app.main.log_view.border_subtitle or "").plain
        assert f"/{pattern}/" in shown or "no regular expression" in said
        await pilot.press("ctrl+e")
        await settle(rig, app, pilot)
        assert "LATCHED" in bar(app)


@piloted
async def test_messages_of_chosen_topics_stand_in_the_log_in_their_universal_form(tmp_path: Path) -> None:
    rig = Rig()
    async with shown(rig, tmp_path) as (app, pilot):
        rig.node.show_messages(frozenset({"mmu/pose", "bridge/odometry"}))
        app.main.set_topics(frozenset({"mmu/pose"}))
        await settle(rig, app, pilot)
        texts = [entry.text for entry in app.main.log_view.book.shown if entry.is_message]
        assert len(texts) == pytest.approx(10, abs=1)
        assert all(text.startswith("MMU_CC_") and ",-1.050," in text for text in texts)


@piloted
async def test_scrolling_up_pauses_and_collecting_goes_on(tmp_path: Path) -> None:
    rig = Rig()
    app = rig.app(tmp_path)
    async with app.run_test(size=SIZE) as pilot:
        for i in range(100):
            rig.log("mmu", "INFO", f"line {i}")
        await settle(rig, app, pilot)
        view = app.main.log_view
        view.focus()
        assert view.scroll_offset.y == view.max_scroll_y > 0
        await pilot.press("pageup")
        await pilot.pause(0.3)
        assert not view.following
        seen = view.scroll_offset.y
        rig.log("mmu", "INFO", "one more")
        await settle(rig, app, pilot)
        assert view.scroll_offset.y == seen
        assert "PAUSED, 1 new" in str(view.border_subtitle)
        await pilot.press("f")
        assert view.scroll_offset.y == view.max_scroll_y


@piloted
async def test_the_filtered_log_is_written_to_a_file(tmp_path: Path) -> None:
    rig = Rig()
    app = rig.app(tmp_path)
    async with app.run_test(size=SIZE) as pilot:
        for _ in range(3):
            rig.log("mmu", "ERROR", "no echo")
        rig.log("mmu", "INFO", "fine")
        await settle(rig, app, pilot)
        await pilot.press("slash", *"echo", "enter", "e")
        (file,) = tmp_path.iterdir()
        (line,) = file.read_text(encoding="utf-8").splitlines()
        assert line.endswith("_ERROR,no echo x3")


@piloted
async def test_the_map_shows_walls_and_the_robot(tmp_path: Path) -> None:
    rig = Rig()
    rig.draw_wall()
    async with shown(rig, tmp_path) as (app, pilot):
        app.main.show_floor(rig.node.floor_picture())
        await pilot.pause()
        assert "80 points" in str(app.main.map.border_subtitle)
        assert "↑" in str(app.main.map.render())


@pytest.mark.parametrize(
    ("keys", "code"),
    [
        (("enter",), None),
        (("escape",), None),
        (("right", "enter"), KEEP_MESH),
        (("right", "right", "enter"), END_MESH),
        (("right", "right", "left", "enter"), KEEP_MESH),
        (("down", "tab", "enter"), END_MESH),
    ],
)
@piloted
async def test_leaving_asks_what_becomes_of_the_mesh_and_enter_alone_changes_nothing(
    keys: tuple[str, ...], code: int | None, tmp_path: Path
) -> None:
    app = Rig().app(tmp_path, owns_mesh=True)
    async with app.run_test(size=SIZE) as pilot:
        await pilot.press("q", *keys)
        await pilot.pause()
        assert app.is_running is (code is None)
    assert app.return_value == code


@pytest.mark.parametrize("size", [(80, 24), (110, 30), (200, 60)])
@piloted
async def test_every_size_of_terminal_shows_bar_modules_and_log(size: tuple[int, int], tmp_path: Path) -> None:
    rig = Rig()
    async with shown(rig, tmp_path, size) as (app, _):
        assert "No stop is latched" in bar(app)
        assert app.main.modules.region.height >= 10
        assert app.main.log_view.size.height >= 3
