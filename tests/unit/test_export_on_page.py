"""A recorded run's page offers every format that can be made of it, and each download is what the verb writes."""

from __future__ import annotations

import io
import urllib.error
import urllib.request
import zipfile
from collections.abc import Iterator
from email.message import Message
from pathlib import Path

import pytest
from mcap.reader import make_reader

from offboard.export.formats import EXPORTS, export, formats_of
from offboard.export.title import TitleBlock
from offboard.runs.run_folder import MAP_POINTS_NAME
from offboard.visualizer.feed_site import FeedSite
from offboard.visualizer.run_view import recorded_run as run_on_page
from offboard.visualizer.server import PageServer
from tests.unit.export_scenes import hall, write_run


def get(server: PageServer, path: str) -> tuple[int, Message, bytes]:
    try:
        with urllib.request.urlopen(server.address + path, timeout=60) as answer:
            return answer.status, answer.headers, answer.read()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.headers, error.read()


@pytest.fixture
def server(recorded_run: Path) -> Iterator[PageServer]:
    made = PageServer(FeedSite(run_on_page(recorded_run).feed, "monday"), "127.0.0.1", 0)
    made.start()
    yield made
    made.close()


@pytest.mark.requirement("VSL_MR_04")
def test_every_format_of_the_registry_can_be_downloaded(server: PageServer, recorded_run: Path) -> None:
    assert formats_of(recorded_run) == list(EXPORTS)
    answers = {form: get(server, f"export/map.{form}") for form in EXPORTS}
    assert {form: status for form, (status, _, _) in answers.items()} == dict.fromkeys(EXPORTS, 200)
    names = {form: headers["Content-Disposition"].split('"')[1] for form, (_, headers, _) in answers.items()}
    assert [names[form] for form in ("pdf", "geojson", "mcap", "bag")] == [
        *("monday-map.pdf", "monday-map.geojson", "monday-run.mcap", "monday-bag.zip")
    ]
    assert make_reader(io.BytesIO(answers["mcap"][2])).get_summary() is not None
    archive = zipfile.ZipFile(io.BytesIO(answers["tables"][2]))
    assert archive.testzip() is None
    assert sorted(archive.namelist()) == ["areas.csv", "doors.csv"]


def test_a_download_is_what_the_verb_writes(server: PageServer, recorded_run: Path, tmp_path: Path) -> None:
    (file,) = export(recorded_run, tmp_path / "out", ["svg"], TitleBlock(recorded_run.name))
    assert get(server, "export/map.svg")[2] == file.read_bytes()


def test_a_file_that_is_damaged_is_one_sentence(server: PageServer, recorded_run: Path) -> None:
    (recorded_run / MAP_POINTS_NAME).write_text("nothing\n")
    status, _, body = get(server, "export/map.svg")
    assert status == 500
    assert body.decode().endswith(f"{MAP_POINTS_NAME} line 1 must be the header x_m,y_m,inferred.")


def test_a_run_without_a_database_offers_what_needs_none(tmp_path: Path) -> None:
    offered = formats_of(write_run(tmp_path / "run", hall()))
    assert set(EXPORTS) - set(offered) == {"mcap", "bag"}
