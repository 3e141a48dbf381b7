"""What the page is told: the newest of everything, the map as increments, ages on one clock, nothing twice."""

from __future__ import annotations

import dataclasses
import zlib
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import ErrorCode
from common.messages.health import Status
from common.messages.mapping import GridUpdate, MapUpdate, PoseEstimate, Trajectory
from common.messages.mission import Outcome, PlannerView
from common.messages.points_of_interest import PointOfInterest
from common.messages.stop import Permit
from common.messages.topics import GRID, MAP, PERMIT, PLAN, POI, POSE, STATUS, TRAJECTORY
from common.modules import SPECIFIED
from offboard.runs import run_folder
from offboard.visualizer.feed import Feed, Held
from offboard.visualizer.live_model import PHOTO_BYTES_MAX, LiveModel
from offboard.visualizer.poi_store import PoiRecord, RunFolderPois
from offboard.visualizer.protocol import PageMessage
from tests.page_socket import unpacked


def pose(x_m: float, t_s: float = 0.0, *, valid: bool = True) -> PoseEstimate:
    return PoseEstimate(t_s, x_m, 0.0, 0.0, 0.0, 0.02, 0.01, 1, valid)


def wall(start: int, xs: list[float], revision: int = 1) -> MapUpdate:
    points = np.array([[x, 1.0] for x in xs], np.float32).reshape(-1, 2)
    return MapUpdate(0.0, revision, start, points, np.zeros(len(xs), np.uint8))


def door(poi_id: int, number: str = "101", photo: bytes = b"", t_s: float = 1.0) -> PointOfInterest:
    return PointOfInterest(t_s, poi_id, "Door", number, 1.0, 2.0, number, "Office", 0.9, "read", photo)


def parsed(message: PageMessage) -> dict[str, Any]:
    """A message as the page reads it, with `body`."""
    head, body = unpacked(message)
    return head | {"body": body} if body else head


CHANNELS = ("plan", "map", "modules", "pois", "trail", "grid")


class Watched:
    """A feed whose clock the test moves, and one page."""

    def __init__(self, store: RunFolderPois | None = None) -> None:
        self.now_s = 100.0
        self.feed = Feed(store, lambda: self.now_s)
        self.page = self.feed.client()

    def messages(self) -> Iterator[dict[str, Any]]:
        """All that is new to the page, one after the other."""
        calls = (self.page.urgent, *(partial(self.page.bulk, channel) for channel in CHANNELS))
        for call in calls:
            while (message := call()) is not None:
                yield parsed(message)

    def news(self) -> dict[str, dict[str, Any]]:
        """By channel; a map that comes as several messages is its last."""
        return {frame["channel"]: frame for frame in self.messages()}

    def heartbeat(self) -> dict[str, Any]:
        return parsed(self.page.heartbeat())

    def ages_s(self) -> dict[str, float]:
        heartbeat = self.heartbeat()
        return {name: heartbeat["now_s"] - arrived_s for name, arrived_s in heartbeat["arrived_s"].items()}


@pytest.fixture
def watched() -> Watched:
    return Watched()


def points(frame: dict[str, Any]) -> list[float]:
    return np.frombuffer(frame.get("body", b""), "<f4", 2 * frame["count"]).reshape(-1, 2)[:, 0].tolist()


def test_a_page_hears_of_everything_once(watched: Watched) -> None:
    watched.feed.take(POSE, pose(1.0))
    watched.feed.take(PERMIT, Permit(0.0, False, "poi is missing", ("operator",)))
    view = PlannerView(0.0, "ROUTE", "driving to a side hall", np.array([[1.0, 2.0]], np.float32), 3, 4.56)
    watched.feed.take(PLAN, view)
    news = watched.news()
    assert (news["pose"]["x_m"], news["pose"]["valid"], news["pose"]["arrived_s"]) == (1.0, True, 100.0)
    assert (news["plan"]["path_m"], news["plan"]["area_m2"]) == ([[1.0, 2.0]], 4.6)
    mission = {"text": "stopped while driving to a side hall", "stage": "explore", "standing": "poi is missing"}
    assert news["mission"] == {"channel": "mission", **mission, "halls": "3 to visit"}
    assert watched.news() == {}


def test_a_page_reads_of_the_mission_what_the_terminal_shows_and_only_when_it_changes(watched: Watched) -> None:
    view = PlannerView(0.0, "ROUTE", "driving to a side hall", np.zeros((0, 2), np.float32), 3, 4.0)
    free = Permit(0.0, True, "", stop_epoch=1)
    watched.feed.take(PERMIT, free)
    watched.feed.take(PLAN, dataclasses.replace(view, paused=True))
    mission = watched.news()["mission"]
    assert (mission["text"], mission["standing"]) == ("paused while driving to a side hall", "paused")
    watched.feed.take(PERMIT, dataclasses.replace(free, t_s=0.1))
    assert "mission" not in watched.news()
    watched.feed.take(
        PLAN, dataclasses.replace(view, mode="DONE", detail="arrived at the place", outcome=Outcome.ARRIVED)
    )
    mission = watched.news()["mission"]
    assert (mission["text"], mission["stage"], mission["halls"]) == (
        "arrived at the place",
        "elsewhere",
        "3 not visited",
    )


@pytest.mark.requirement("VSL_MR_04")
def test_the_map_goes_out_as_increments(watched: Watched) -> None:
    watched.feed.take(MAP, wall(0, [1.0, 2.0]))
    assert points(watched.news()["map"]) == [1.0, 2.0]
    watched.feed.take(MAP, wall(2, [3.0]))
    watched.feed.take(MAP, wall(3, [4.0]))
    news = watched.news()["map"]
    assert (news["start"], points(news)) == (2, [3.0, 4.0])


def test_a_corrected_map_goes_out_whole(watched: Watched) -> None:
    watched.feed.take(MAP, wall(0, [1.0, 2.0]))
    watched.news()
    watched.feed.take(MAP, wall(0, [1.5, 2.5, 3.5], revision=2))
    news = watched.news()["map"]
    assert (news["start"], points(news)) == (0, [1.5, 2.5, 3.5])


@given(st.lists(st.one_of(st.none(), st.integers(0, 5), st.just("anew")), max_size=30))
def test_however_slow_a_page_is_it_ends_with_the_whole_map(story: list[int | str | None]) -> None:
    """None: the page looks. A number: so many points come. "anew": the map begins again."""
    watched = Watched()
    sent, seen, revision = 0, [], 0
    for event in [*story, None]:
        if event is None:
            news = watched.news().get("map")
            if news is not None:
                seen = seen[: news["start"]] + points(news)
        elif event == "anew":
            revision += 1
            watched.feed.take(MAP, wall(0, [float(revision)], revision))
            sent = 1
        else:
            watched.feed.take(MAP, wall(sent, [float(sent + k) for k in range(int(event))], revision))
            sent += int(event)
    assert seen == watched.feed.map_data().points_m[:, 0].tolist()


def test_a_slow_page_skips_poses_and_knows_how_many(watched: Watched) -> None:
    for k in range(3):
        watched.feed.take(POSE, pose(float(k)))
    assert watched.news()["pose"]["x_m"] == 2.0
    assert watched.heartbeat()["skipped"] == 0
    for k in range(5):
        watched.feed.take(POSE, pose(float(k)))
    assert [watched.news()["pose"]["x_m"], watched.heartbeat()["skipped"]] == [4.0, 4]


def test_ages_count_from_arrival(watched: Watched) -> None:
    assert watched.ages_s() == {}
    watched.feed.take(POSE, pose(0.0, t_s=5000.0))
    watched.now_s += 1.5
    watched.feed.take(PERMIT, Permit(0.0, True, ""))
    watched.now_s += 0.5
    assert watched.ages_s() == {"pose": 2.0, "robot": 0.5}


def test_what_the_laptop_says_does_not_make_the_robot_fresh(watched: Watched) -> None:
    watched.feed.take(STATUS["recorder"], Status(0.0, "recording", 0, 1, True, 1))
    assert set(watched.ages_s()) == {"recorder"}


def test_every_module_is_named_with_its_error_in_words(watched: Watched) -> None:
    watched.feed.take(STATUS["mmu"], Status(0.0, "WAITING", int(ErrorCode.NO_ODOMETRY), 7, False, 1))
    watched.feed.take(STATUS["planner"], Status(0.0, "X", 4711, 7, True, 1))
    modules = {module["name"]: module for module in watched.news()["modules"]["modules"]}
    assert set(modules) == {module.name for module in SPECIFIED}
    assert modules["mmu"]["meaning"] == "no odometry arrives"
    assert modules["planner"]["meaning"].startswith("an error that this version")
    assert "state" not in modules["poi"]


def test_an_uncertainty_without_bounds_goes_out_as_null(watched: Watched) -> None:
    watched.feed.take(POSE, dataclasses.replace(pose(1.0), sd_xy_m=float("inf")))
    assert watched.news()["pose"]["sd_xy_m"] is None


def test_the_trail_is_smoothed_as_far_as_that_reaches(watched: Watched) -> None:
    for k in range(4):
        watched.feed.take(POSE, pose(float(k), t_s=float(k)))
    watched.feed.take(TRAJECTORY, Trajectory(2.0, np.array([0.0, 1.0]), np.array([[0.0, 9.0, 0.0], [1.0, 9.0, 0.0]])))
    way = np.frombuffer(watched.news()["trail"]["body"], "<f4").reshape(-1, 2).tolist()
    assert way == [[0.0, 9.0], [1.0, 9.0], [2.0, 0.0], [3.0, 0.0]]


def test_the_floor_goes_out_as_it_came(watched: Watched) -> None:
    cells = np.array([[0, 1, 2]], np.uint8)
    watched.feed.take(GRID, GridUpdate(0.0, 1, -1.0, -2.0, 0.05, 1, 3, zlib.compress(cells.tobytes())))
    grid = watched.news()["grid"]
    assert zlib.decompress(grid["body"]) == cells.tobytes()
    assert (grid["rows"], grid["columns"], grid["origin"]) == (1, 3, [-1.0, -2.0])


def test_what_a_module_repeats_does_not_go_out_again(watched: Watched) -> None:
    watched.feed.take(STATUS["mmu"], Status(0.0, "MAPPING", 0, 7, True, 1))
    assert "modules" in watched.news()
    watched.feed.take(STATUS["mmu"], Status(0.1, "MAPPING", 0, 7, True, 2))
    assert watched.news() == {}
    assert watched.ages_s()["mmu"] == 0.0


def test_coordinates_stay_those_of_the_map_while_it_grows_to_the_left_and_down(watched: Watched) -> None:
    """The page, the terminal and `goto` name one place by the same two numbers, all through a run."""
    watched.feed.take(POI, door(1))
    watched.feed.take(MAP, wall(0, [-3.0]))
    first = watched.news()
    watched.feed.take(MAP, wall(1, [-40.0]))
    second = watched.news()
    assert (first["pois"]["pois"][0]["x_m"], "pois" in second) == (1.0, False)
    assert set(second["map"]) == {"channel", "epoch", "start", "count", "total", "body"}


def test_a_long_map_goes_out_in_pieces_and_goes_on_where_the_page_has_it(watched: Watched) -> None:
    watched.feed.take(MAP, wall(0, [float(k) for k in range(1000)]))
    pieces = list(watched.messages())[:2]
    assert [piece["start"] for piece in pieces] == [0, 400]
    has = pieces[0]["epoch"], pieces[0]["count"]
    watched.page = watched.feed.client(Held(watched.feed.model_id, *has))
    rest = [frame for frame in watched.messages() if frame["channel"] == "map"]
    assert [(piece["start"], piece["count"], piece["total"]) for piece in rest] == [(400, 400, 1000), (800, 200, 1000)]


@pytest.mark.parametrize("held", [("other", 0, 400), (None, 1, 400), (None, 0, 1001)], ids=["model", "epoch", "more"])
def test_a_page_that_has_another_map_is_given_all_of_this(watched: Watched, held: tuple[str | None, int, int]) -> None:
    watched.feed.take(MAP, wall(0, [float(k) for k in range(1000)]))
    model_id, epoch, points_held = held
    watched.page = watched.feed.client(Held(model_id or watched.feed.model_id, epoch, points_held))
    first = next(frame for frame in watched.messages() if frame["channel"] == "map")
    assert first["start"] == 0


class TestPointsOfInterest:
    def test_a_photo_stays_when_the_record_is_corrected(self, watched: Watched) -> None:
        watched.feed.take(POI, door(1, "10?", b"jpeg"))
        watched.feed.take(POI, door(1, "101"))
        (poi,) = watched.news()["pois"]["pois"]
        assert (poi["number"], poi["has_photo"]) == ("101", True)
        assert watched.feed.photo(1) == b"jpeg"
        assert watched.feed.photo(2) is None

    def test_those_of_the_recorder_are_there_after_a_restart(self, tmp_path: Path) -> None:
        watched = Watched(RunFolderPois(tmp_path))
        watched.feed.refresh_pois()
        assert watched.news()["pois"]["pois"] == []
        (tmp_path / "photos").mkdir()
        (tmp_path / "photos" / "poi_1.jpg").write_bytes(b"jpeg")
        write_pois(tmp_path, entry(1, photo="photos/poi_1.jpg"), entry(2))
        watched.feed.refresh_pois()
        assert [poi["has_photo"] for poi in watched.news()["pois"]["pois"]] == [True, False]
        assert (watched.feed.photo(1), watched.feed.photo(2)) == (b"jpeg", None)

    def test_what_came_live_and_is_newer_stays(self, tmp_path: Path) -> None:
        watched = Watched(RunFolderPois(tmp_path))
        watched.feed.take(POI, door(1, "102", b"new", t_s=5.0))
        write_pois(tmp_path, entry(1, t_s=3.0))
        watched.feed.refresh_pois()
        assert watched.news()["pois"]["pois"][0]["number"] == "102"
        assert watched.feed.photo(1) == b"new"

    @pytest.mark.parametrize("text", ["", "[{}]", "[1]", "{", '[{"poi_id": "x"}]'])
    def test_a_broken_file_is_left_until_it_is_whole(self, tmp_path: Path, text: str) -> None:
        (tmp_path / run_folder.POIS_NAME).write_text(text, encoding="utf-8")
        store = RunFolderPois(tmp_path)
        assert store.read() is None
        write_pois(tmp_path, entry(1))
        assert store.read() == [
            PoiRecord(1, "Door", "", 1.0, 2.0, "101", "Office", 0.5, "read", 1.0, False, "101", "read")
        ]
        assert store.read() is None

    def test_no_file_outside_the_run_is_ever_a_photo(self, tmp_path: Path) -> None:
        (tmp_path / "secret").write_bytes(b"secret")
        run = tmp_path / "run"
        run.mkdir()
        write_pois(run, entry(1, photo="../secret"), entry(2, photo=str(tmp_path / "secret")))
        store = RunFolderPois(run)
        store.read()
        assert [store.photo(1), store.photo(2)] == [None, None]


def entry(poi_id: int, photo: str = "", t_s: float = 1.0) -> dict[str, Any]:
    values = {"poi_id": poi_id, "name": "Door", "description": "", "x_m": 1.0, "y_m": 2.0, "number": "101"}
    return values | {"room_type": "Office", "confidence": 0.5, "state": "read", "t_s": t_s, "photo": photo}


def write_pois(folder: Path, *entries: dict[str, Any]) -> None:
    run_folder.write_json(folder / run_folder.POIS_NAME, list(entries))


def test_photos_that_no_store_takes_are_kept_up_to_a_limit() -> None:
    model = LiveModel()
    for number in range(40):
        model.take(POI, door(number, photo=bytes(1_000_000)), 1.0)
    assert sum(map(len, model.photos.values())) <= PHOTO_BYTES_MAX
    assert 39 in model.photos
    assert len(model.pois) == 40
