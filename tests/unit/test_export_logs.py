"""Whole runs as logs of others: MCAP by its own library, bags by rosbags, trajectories by evo; also after a kill."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from mcap_ros2.decoder import DecoderFactory as Ros2Decoder
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from common.codec import encode
from common.messages.health import LogLine
from common.messages.mapping import PoseEstimate
from common.messages.mission import Outcome
from common.messages.topics import LOG, POSE
from common.recording import RecordedMessage
from offboard.evaluate.summary import RunFacts, write_summary
from offboard.export.formats import export
from offboard.export.json_schema import as_json, schema_of
from offboard.export.run_time import RunTime
from offboard.runs.run_database import RunReader
from offboard.runs.run_folder import read_tum, write_tum
from offboard.runs.run_schema import Delivery, RunDatabase
from offboard.runs.stamped_truth import stamp_truth

ROOT = Path(__file__).parents[2]


def decoded(file: Path) -> list[tuple[Any, Any, Any, Any]]:
    """Schema, channel, message and its content, of every message."""
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory(), JsonDecoder()])
        return list(reader.iter_decoded_messages())


class JsonDecoder:
    """The standard parser refuses nothing that a browser's JSON.parse takes, but takes NaN: that is refused here."""

    def decoder_for(self, encoding: str, schema: Any) -> Any:
        def no_constant(name: str) -> None:
            raise ValueError(name)

        return (lambda data: json.loads(data, parse_constant=no_constant)) if encoding == "json" else None


def test_an_mcap_holds_every_message_of_the_run_with_schemas_of_the_players(recorded_run: Path, tmp_path: Path) -> None:
    (file,) = export(recorded_run, tmp_path, ["mcap"])
    messages = decoded(file)
    count = Counter(channel.topic for _, channel, _, _ in messages)
    with RunReader(recorded_run) as run:
        recorded = run.counts()
    assert count["/pose"] == count["/tf"] == count["/mmu/pose"] == recorded[POSE.key] == 40
    assert count["/sonars"] == recorded["bridge/ranges"]
    assert count["/mmu/status"] == recorded["mmu/status"]
    assert {count["/walls"], count["/path"], count["/map"], count["/doors"], count["/photos"]} <= {1, 2}
    names = {schema.name for schema, channel, _, _ in messages if "/" not in channel.topic[1:]}
    assert names == {
        f"foxglove.{name}"
        for name in ("PoseInFrame", "FrameTransform", "LaserScan", "PointCloud", "PosesInFrame")
        + ("Grid", "SceneUpdate", "CompressedImage")
    }


def test_what_an_mcap_shows_is_what_was_measured(recorded_run: Path, tmp_path: Path) -> None:
    (file,) = export(recorded_run, tmp_path, ["mcap"])
    first: dict[str, Any] = {}
    last: dict[str, Any] = {}
    for _, channel, message, content in decoded(file):
        first.setdefault(channel.topic, content)
        last[channel.topic] = content
        stamp = getattr(content, "timestamp", None)
        if stamp is not None:
            assert stamp.ToNanoseconds() == message.log_time
    assert last["/pose"].pose.position.x == pytest.approx(last["/mmu/pose"]["x_m"])
    assert list(first["/sonars"].ranges)[:2] == [1.0, 2.0]
    assert np.isnan(list(first["/sonars"].ranges)[2])
    assert first["/bridge/ranges"]["range_m"][2] is None
    (text,) = first["/doors"].entities[0].texts
    assert text.text.startswith("101")
    walls = np.frombuffer(last["/walls"].data, "<f4").reshape(-1, 4)
    assert len(walls) == 60
    grid = last["/map"]
    assert len(grid.data) == grid.row_stride * (len(grid.data) // grid.row_stride)
    assert set(grid.data) <= {0, 205, 254}


def test_senders_whose_clocks_differ_share_the_recorders_time(tmp_path: Path) -> None:
    """Two boards measure at the same moments, on clocks that were switched on hours apart; some messages come late."""
    database = RunDatabase(tmp_path / "run.sqlite", "2026-01-02T03:04:05+00:00", recorder_id=7)
    for k in range(1, 11):
        late_s = 60.0 if k % 3 else 0.02
        pose = PoseEstimate(5000.0 + k, 0.0, 0.0, 0.0, 0.0, 0.01, 0.01, 1)
        line = LogLine(77_000.0 + k, "INFO", "there")
        both = [RecordedMessage(t.key, b, k, encode(p, k, b)) for t, b, p in ((POSE, 1, pose), (LOG["poi"], 2, line))]
        database.store_data(Delivery(300.0 + k + late_s, both))
    with RunReader(tmp_path) as run:
        time = RunTime(run)
        poses, lines = ([time.of(m) for m in run.messages(topic)] for topic in (POSE, LOG["poi"]))
        began_ns = run.dates()[0].timestamp() * 1e9
    np.testing.assert_allclose(poses, lines, atol=1e6)
    np.testing.assert_allclose(np.diff(poses), 1e9, atol=1e3)
    assert abs(poses[0] - began_ns) < 61e9


def test_a_message_as_json_fits_its_schema(recorded_run: Path) -> None:
    with RunReader(recorded_run) as run:
        for message in run.display_data():
            properties = json.loads(schema_of(message.topic.payload))["properties"]
            content = json.loads(as_json(message.payload))
            assert content.keys() == properties.keys()


_WRITES_FOR_EVER = """
import itertools, sys
from pathlib import Path
from common.codec import encode
from common.messages.mapping import PoseEstimate
from common.messages.topics import POSE
from common.recording import RecordedMessage
from offboard.runs.run_schema import Delivery, RunDatabase

database = RunDatabase(Path(sys.argv[1]) / "run.sqlite", "2026-01-02T03:04:05+00:00", recorder_id=7)
for k in itertools.count(1):
    pose = PoseEstimate(0.1 * k, 0.01 * k, 0.0, 0.0, 0.0, 0.01, 0.01, 1)
    database.store_data(Delivery(0.1 * k, [RecordedMessage(POSE.key, 1, k, encode(pose, k, 1))]))
    print(k, flush=True)
"""
_EXPORTS_SLOWLY = """
import sys, time
from pathlib import Path
from offboard.export import mcap_log
from offboard.export.formats import export

first = mcap_log._Log.add_json
def add(self, *arguments):
    first(self, *arguments)
    print("some", flush=True)
    time.sleep(0.05)
mcap_log._Log.add_json = add
export(Path(sys.argv[1]), Path(sys.argv[2]), ["mcap"])
"""


def kill_after(lines: int, program: str, *arguments: Path) -> None:
    """Runs it, and kills it when it has printed so many lines."""
    command = [sys.executable, "-c", program, *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        assert process.stdout is not None
        for _ in range(lines):
            assert process.stdout.readline()
        process.send_signal(signal.SIGKILL)


def test_a_run_that_was_killed_opens_as_mcap_with_all_that_was_stored(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    kill_after(200, _WRITES_FOR_EVER, tmp_path / "run")
    (file,) = export(tmp_path / "run", tmp_path / "out", ["mcap"])
    assert sum(channel.topic == "/pose" for _, channel, _, _ in decoded(file)) >= 200


def test_a_killed_export_leaves_no_half_of_a_file_and_the_next_one_is_whole(recorded_run: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    kill_after(3, _EXPORTS_SLOWLY, recorded_run, out)
    assert not (out / "run.mcap").exists()
    (file,) = export(recorded_run, out, ["mcap"])
    assert decoded(file)
    assert [path.name for path in out.iterdir()] == ["run.mcap"]


def test_a_ros_bag_holds_map_poses_sonars_and_doors_for_rosbags(recorded_run: Path, tmp_path: Path) -> None:
    (folder,) = export(recorded_run, tmp_path, ["bag"])
    store = get_typestore(Stores.ROS2_JAZZY)
    with Reader(folder) as reader:
        count = {connection.topic: connection.msgcount for connection in reader.connections}
        newest = {c.topic: store.deserialize_cdr(data, c.msgtype) for c, _, data in reader.messages()}
        latched = {c.topic for c in reader.connections if c.ext.offered_qos_profiles}
    assert count["/pose"] == count["/tf"] == count["/range/left"] == 40
    assert latched == {"/map", "/tf_static", "/path", "/doors"}
    grid = newest["/map"]
    assert len(grid.data) == grid.info.width * grid.info.height
    assert set(np.unique(grid.data)) <= {-1, 0, 100}
    assert newest["/range/front"].range == np.inf
    assert newest["/doors"].markers[1].text.startswith("102")
    assert newest["/pose"].header.frame_id == newest["/tf"].transforms[0].header.frame_id == "map"


def test_another_decoder_reads_the_same_from_the_bag(recorded_run: Path, tmp_path: Path) -> None:
    (folder,) = export(recorded_run, tmp_path, ["bag"])
    file = folder / "ros2_bag.mcap"
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[Ros2Decoder()])
        newest = {channel.topic: content for _, channel, _, content in reader.iter_decoded_messages()}
    with RunReader(recorded_run) as run:
        pose = run.latest(POSE)
        assert pose is not None
    assert newest["/pose"].pose.pose.position.x == pytest.approx(pose.payload.x_m)
    assert newest["/tf"].transforms[0].child_frame_id == "base_link"
    assert {newest["/range/left"].range, newest["/range/front"].range} == {1.0, np.inf}
    assert [marker.text for marker in newest["/doors"].markers] == ["", "102 Office"]
    assert newest["/map"].info.resolution == pytest.approx(0.05)


def test_a_second_export_replaces_the_bag_of_the_first(recorded_run: Path, tmp_path: Path) -> None:
    for _ in range(2):
        export(recorded_run, tmp_path, ["bag"])
    with Reader(tmp_path / "ros2_bag") as reader:
        assert reader.message_count > 0


def simulated_run(folder: Path) -> Path:
    """Truth every 0.1 s; an estimate between two of these each time, in a frame of its own, as the robot makes it."""
    folder.mkdir()
    times_s = np.arange(0.0, 60.0, 0.1)
    truth = np.column_stack([3 * np.cos(times_s / 9) + times_s / 20, 2 * np.sin(times_s / 7), times_s / 30])
    stamps_s = times_s[5:-1] + 0.06
    at = np.column_stack([np.interp(stamps_s, times_s, truth[:, k]) for k in range(3)])
    write_tum(folder / "truth.tum", times_s, truth)
    write_tum(folder / "trajectory.tum", stamps_s, at)
    write_tum(folder / "trajectory_smoothed.tum", stamps_s[::25], at[::25])
    return folder


def evo_ape(truth: Path, estimate: Path, home: Path) -> str:
    pytest.importorskip("evo")
    command = [str(Path(sys.executable).with_name("evo_ape")), "tum", str(truth), str(estimate)]
    done = subprocess.run(command, capture_output=True, text=True, env={"HOME": str(home), "PATH": ""}, timeout=100)
    return done.stdout + done.stderr


def test_evo_joins_the_truth_with_both_estimates_of_a_run(tmp_path: Path) -> None:
    run = simulated_run(tmp_path / "run")
    assert "rmse" not in evo_ape(run / "truth.tum", run / "trajectory_smoothed.tum", tmp_path)
    stamp_truth(run)
    said = evo_ape(run / "truth.tum", run / "trajectory_smoothed.tum", tmp_path)
    (rmse,) = [float(line.split()[1]) for line in said.splitlines() if line.split()[:1] == ["rmse"]]
    assert rmse < 0.002


def test_stamping_keeps_every_pose_of_the_truth_and_adds_one_per_estimate_once(tmp_path: Path) -> None:
    run = simulated_run(tmp_path / "run")
    before_s, before = read_tum(run / "truth.tum")
    for _ in range(2):
        stamp_truth(run)
    times_s, poses = read_tum(run / "truth.tum")
    estimate_s, _ = read_tum(run / "trajectory.tum")
    assert set(times_s) == set(before_s) | set(estimate_s)
    assert np.all(np.diff(times_s) > 0)
    np.testing.assert_allclose(poses[np.isin(times_s, before_s)], before, atol=2e-4)


def test_the_end_of_a_run_in_simulation_stamps_its_truth(tmp_path: Path) -> None:
    run = simulated_run(tmp_path / "run")
    write_summary(run, RunFacts("loop", 1, 0, {}, Outcome.FINISHED, "home", 60.0, 1.0, {}))
    estimate_s, _ = read_tum(run / "trajectory_smoothed.tum")
    assert set(estimate_s) <= set(read_tum(run / "truth.tum")[0])


def test_the_truth_of_a_run_that_was_cut_off_gets_its_stamps_in_the_export(tmp_path: Path) -> None:
    run = simulated_run(tmp_path / "run")
    export(run, tmp_path / "out", ["tum"])
    estimate_s, _ = read_tum(run / "trajectory.tum")
    assert set(estimate_s) <= set(read_tum(tmp_path / "out" / "truth.tum")[0])
    assert len(read_tum(run / "truth.tum")[0]) == 600
