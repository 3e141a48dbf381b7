"""Programs of different message tables do not drive a robot together, and one sentence names both releases."""

from __future__ import annotations

import time
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from common.bus import LocalBus, LocalMesh
from common.clock import FreeClock
from common.config import CommSection, Config, MeshSection, apart
from common.messages.health import Status
from common.messages.mapping import PoseEstimate
from common.messages.motion import CarrierReport, CarrierState
from common.messages.stop import Permit
from common.messages.topics import CARRIER, PERMIT, POSE, STATUS, TOPICS, Topic
from common.release import Release, messages_hash, own_release, release_of_key
from common.zenoh_bus import ZenohBus
from deploy.local.ports import reserve_port
from onboard.comm.comm import Comm
from onboard.comm.permit_file import PermitFile, permit_file
from onboard.comm.watchdog import release_faults

OWN = own_release()
OLDER = Release("v1", "0123456789ab")


def test_the_hash_follows_keys_fields_and_types_of_the_messages() -> None:
    @dataclass(frozen=True)
    class Longer(PoseEstimate):
        added: str = ""

    changed: list[Topic[object]] = [replace(POSE, key="mmu/place"), replace(POSE, payload=Longer)]  # type: ignore[arg-type]
    hashes = {messages_hash((topic,)) for topic in (POSE, *changed)}
    assert len(hashes) == 3
    assert messages_hash(TOPICS) == messages_hash(tuple(TOPICS)) == OWN.messages


def test_a_release_is_read_back_from_the_key_that_it_is_written_to() -> None:
    assert release_of_key(OLDER.key) == OLDER
    assert release_of_key("") is None
    assert release_of_key("a/b/c") is None


@pytest.mark.requirement("CM_MR_02")
def test_one_sentence_names_both_releases_and_only_modules_on_the_robot_count() -> None:
    releases = {("mmu", OWN), ("bridge", OLDER), ("recorder", OLDER), ("planner", Release("v3", OWN.messages))}
    assert release_faults(releases, OWN) == [f"bridge runs release v1, comm release {OWN.name}"]


class TokenBus(LocalBus):
    """As a bus between processes has them: tokens of the modules that run, with their releases."""

    releases: frozenset[tuple[str, Release]] = frozenset()

    def alive_tokens(self) -> frozenset[str]:
        return frozenset(module for module, _ in self.releases)

    def alive_releases(self) -> frozenset[tuple[str, Release]]:
        return self.releases


class Robot:
    """comm, and modules that only report."""

    def __init__(self, permit_file: PermitFile) -> None:
        self.mesh = LocalMesh(bus=TokenBus)
        self.modules, self.bus = self.mesh.endpoint("modules"), self.mesh.endpoint("comm")
        self.comm = Comm(CommSection(required=("bridge", "mmu")), permit_file=permit_file)
        self.heartbeats = 0

    def run(self, releases: dict[str, Release]) -> Permit:
        """Two seconds; the last permit."""
        assert isinstance(self.bus, TokenBus)
        self.bus.releases = frozenset(releases.items())
        for _ in range(20):
            self.mesh.now_s += 0.1
            self.heartbeats += 1
            for module in ("bridge", "mmu"):
                self.modules.publish(STATUS[module], Status(self.mesh.now_s, "RUN", 0, 0, True, self.heartbeats))
            self.comm.step(self.bus, self.mesh.now_s)
            permit = self.modules.latest(PERMIT)
            known = {} if permit is None else {"comm_life": permit.life, "bridge_epoch": permit.stop_epoch}
            report = CarrierReport(self.mesh.now_s, CarrierState.READY, 0, 0, 0, 0.0, 0, 0, True, False, 12.0, **known)
            self.modules.publish(CARRIER, report)
        assert permit is not None
        return permit


@pytest.mark.requirement("CM_MR_02")
def test_no_permit_while_a_board_runs_another_release_and_a_file_shows_it_to_deploy(tmp_path: Path) -> None:
    robot, file = Robot(PermitFile(tmp_path / "permit")), tmp_path / "permit"
    assert robot.run({"bridge": OWN, "mmu": OWN}).granted
    assert file.read_text() == "granted"
    refused = robot.run({"bridge": OLDER, "mmu": OWN})
    assert not refused.granted
    assert refused.reason == f"bridge runs release v1, comm release {OWN.name}"
    assert file.read_text() == "withheld"
    assert robot.run({"bridge": OWN, "mmu": OWN}).granted
    robot.comm.close()
    assert file.read_text() == "withheld"


def test_a_token_carries_its_release_over_the_mesh(monkeypatch: pytest.MonkeyPatch) -> None:
    config = apart(Config(mesh=MeshSection(router=f"tcp/127.0.0.1:{reserve_port()}")))
    with closing(ZenohBus("comm", config, FreeClock(), "router")) as comm:
        monkeypatch.setattr("common.zenoh_end.own_release", lambda: OLDER)
        with closing(ZenohBus("bridge", config, FreeClock())):
            end_s = time.monotonic() + 10.0
            while ("bridge", OLDER) not in comm.alive_releases():
                assert time.monotonic() < end_s, comm.alive_releases()
                time.sleep(0.01)


def test_without_a_runtime_folder_there_is_no_permit_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("RUNTIME_DIRECTORY", raising=False)
    assert permit_file() is None
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    made = permit_file()
    assert made is not None
    made.write(granted=True)
    assert (tmp_path / "permit").read_text() == "granted"
