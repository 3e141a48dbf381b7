"""A mesh with keys over real TLS: the rightful command center is obeyed, and nobody else, whatever he holds."""

from __future__ import annotations

import shutil
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import zenoh

from common.clock import FreeClock
from common.codec import encode
from common.config_file import config_text
from common.constants import PERMIT_RATE_HZ
from common.keys import AUTHORITY
from common.messages.mission import Operation, OperatorCommand
from common.messages.motion import DriveCommand, Speed
from common.messages.stop import Permit, StopRequest
from common.messages.topics import DRIVE, MAP, OPERATION, PERMIT, PLAN, STATUS, STOP, Topic
from common.reply_budget import BURST_BYTES, RATE_BYTES_S
from common.zenoh_bus import ZenohBus
from common.zenoh_channel import Channel, session_config
from common.zenoh_session import direct
from offboard.command_center.log_book import LogEntry
from offboard.operate.bus_operator import BusOperator, OperatorView
from offboard.operate.door_sender import SENTENCES, OfDoor
from offboard.operate.operations import Answer, Order
from offboard.operate.software_stop import SOURCE
from offboard.runs.run_database import RunReader
from tests.system.center import Center
from tests.system.conftest import Mesh, free_endpoint, until

certificates = pytest.importorskip("deploy.boards.certificates", reason="pip install cryptography")
pytestmark = pytest.mark.timeout(60)
FLOOD_S = 1.5
LATER = datetime.now(UTC) + timedelta(days=1)
HOSTS = {"robot": ["127.0.0.1"]}
Signed = tuple[str, bytes, bytes | None]  # key, message, signature


class KeyedMesh(Mesh):
    """Robot and laptop with keys, on one machine but joined by TLS alone; the Command Center is there."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.keys = folder / "keys"
        certificates.make_keys(self.keys, HOSTS, replace=False, until=LATER)
        endpoint = free_endpoint().replace("tcp/", "tls/")
        mesh = replace(self.config.mesh, listen=endpoint, robot=endpoint, keys=str(self.keys))
        self.config = replace(self.config, mesh=mesh)
        self.config_file.write_text(config_text(self.config), encoding="utf-8")
        self.run_dir = folder / "run"
        self._center: Center | None = None
        self._log: list[LogEntry] = []  # what the Command Center shows, since the last stop

    @property
    def center(self) -> Center:
        assert self._center is not None
        return self._center

    def begin(self) -> None:
        self.start("recorder", "-m", "offboard.recorder", extra=("--run-dir", str(self.run_dir)))
        self.start_all()
        self._center = Center(self.config)

    def by_tls(self, keys: Path) -> Channel:
        return Channel("client", connect=(self.config.mesh.robot,), keys=keys)

    def keyed(self, topic: Topic[object]) -> str:
        return f"{self.config.robot.name}/{topic.key}"

    def await_complaints(self, *texts: str, by: str = "comm") -> None:
        """Until a module has said these in the command center's log, since the last stop."""

        def heard() -> bool:
            self._log += self.center.node.take_log()
            lines = [entry.message for entry in self._log if entry.module == by]
            return all(any(text in line for line in lines) for text in texts)

        until(heard, what=texts)

    def stop(self) -> None:
        """The rightful stop, held by the robot."""
        self.center.node.stop_desk.press()
        until(lambda: self.latched and self.standing, what="the stop")
        self.center.node.take_log()
        self._log.clear()

    def go(self) -> None:
        """Until the robot moves, whatever was before."""
        until(lambda: self.center.live() >= {"comm", "planner"}, what="the robot in the command center")
        until(self._answered, what="the answer to what was asked before")
        if self.latched:
            until(lambda: not self.center.node.stop_desk.hindrance(), what="a stop that may be released")
            self.center.node.stop_desk.release()
            until(lambda: not self.latched, what="the release")
            assert self.standing
        until(self._moves, what="motion")

    def _answered(self) -> bool:
        operation = self.center.node.snapshot().operation
        return operation is None or operation.answer is not Answer.WAITING

    def _moves(self) -> bool:
        """Asks again after each answer: a planner that was started anew waits for it."""
        if self._answered():
            self.center.node.operate(Operation.RESUME)
        return not self.standing

    @property
    def latched(self) -> bool:
        return self.permits[-1][1].stop_sources == (SOURCE,)

    def withstands(self, send: Callable[[], None]) -> bool:
        """The robot stands and holds its stop while all that is sent again and again, for six permits."""
        before = len(self.permits)

        def over() -> bool:
            send()
            assert self.standing
            return len(self.permits) >= before + 6

        until(over, what="permits")
        return all(permit.stop_sources == (SOURCE,) and not permit.granted for _, permit in self.permits[before:])

    def close(self) -> None:
        if self._center is not None:
            self._center.close()
        super().close()


@pytest.fixture(scope="module")
def keyed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[KeyedMesh]:
    with closing(KeyedMesh(tmp_path_factory.mktemp("keyed"))) as made:
        made.begin()
        yield made


def orders(mesh: KeyedMesh) -> list[Signed]:
    """All that could set the robot going, from a sender without the command key."""
    sequence, boot_id, epoch = 1_000_000, 4711, mesh.permits[-1][1].stop_epoch
    wanted = (
        (STOP, StopRequest(0.0, SOURCE, latched=False, epoch=epoch)),
        (OPERATION, OperatorCommand(0.0, Operation.RESUME, command_id=77, epoch=epoch)),
        (PERMIT, Permit(0.0, True, "", stop_epoch=epoch)),
        (DRIVE, DriveCommand(0.0, 5, Speed.MEDIUM, 0.0)),
    )
    return [(mesh.keyed(topic), encode(payload, sequence, boot_id), None) for topic, payload in wanted]


def no_right(speaker: str, topic: Topic[Any]) -> str:
    return f"a message was refused: it has no right to it {speaker} topic={topic.key}"


def put_all(session: zenoh.Session, messages: list[Signed]) -> Callable[[], None]:
    def send() -> None:
        for key, data, signature in messages:
            session.put(key, data, attachment=signature)

    return send


@pytest.mark.requirement("CC_MR_04")
def test_the_rightful_command_center_starts_stops_and_releases_the_robot_over_tls(keyed: KeyedMesh) -> None:
    keyed.go()
    keyed.stop()
    until(lambda: keyed.center.node.stop_desk.control.latency_s is not None, what="the confirmation")
    keyed.go()
    assert keyed.command("estop").returncode == 0
    assert keyed.latched
    released = keyed.command("release")
    assert released.returncode == 0, released.stderr
    assert keyed.standing
    resumed = keyed.command("resume")
    assert resumed.returncode == 0, resumed.stderr
    until(lambda: not keyed.standing, what="motion")

    def recorded() -> bool:
        with RunReader(keyed.run_dir) as run:
            keys = {key for key, _ in run.senders()}
        return {STOP.key, OPERATION.key, "mmu/status", "command_center/status"} <= keys

    until(recorded, what="the robot's and the laptop's messages in the database")


@pytest.mark.requirement("CC_MR_04")
def test_a_page_with_the_keys_stops_releases_and_notes_a_door_over_tls(keyed: KeyedMesh) -> None:
    keyed.go()
    views = [OperatorView()]
    operator = BusOperator(lambda: ZenohBus("command_center", keyed.config, FreeClock(), "client"), views.append)
    operator.open()
    try:
        operator.stop()
        until(lambda: views[-1].stop == "LATCHED" and not views[-1].latched, what="a stop that may be released")
        assert keyed.standing
        operator.release(views[-1].epoch)
        until(lambda: views[-1].stop == "RELEASED", what="the release")
        assert keyed.standing
        operator.operate(Order(Operation.RESUME))
        until(lambda: not keyed.standing, what="motion")
        operator.note_door(OfDoor(3, 5.0, 1.0, "241", "Kitchen"))
        until(lambda: views[-1].answer == SENTENCES[Answer.TAKEN], what="the recorder's answer")
    finally:
        operator.close()


def test_a_page_without_the_keys_of_the_command_center_says_so_and_orders_nothing(
    keyed: KeyedMesh, tmp_path: Path
) -> None:
    shutil.copytree(keyed.keys / "laptop", tmp_path / "laptop")
    config = replace(keyed.config, mesh=replace(keyed.config.mesh, keys=str(tmp_path)))
    views = [OperatorView()]
    operator = BusOperator(lambda: ZenohBus("command_center", config, FreeClock(), "client"), views.append)
    operator.open()
    try:
        until(lambda: views[-1].hindrance, what="the reason")
        assert "command_center" in views[-1].hindrance
        assert views[-1].stop == "LINK_LOST"
    finally:
        operator.close()


def test_a_viewers_certificate_sees_the_robot_and_moves_nothing(keyed: KeyedMesh) -> None:
    keyed.stop()
    with zenoh.open(session_config(keyed.by_tls(keyed.keys / "viewer"))) as viewer:
        seen: list[bytes] = []
        ear = viewer.declare_subscriber(
            keyed.keyed(PERMIT),
            zenoh.handlers.Callback(lambda sample: seen.append(bytes(sample.payload)), indirect=False),
        )
        assert keyed.withstands(put_all(viewer, orders(keyed)))
        assert len(seen) >= 3
        ear.undeclare()
    keyed.await_complaints(*(no_right("certificate=viewer", topic) for topic in (STOP, OPERATION, PERMIT, DRIVE)))


class Flood:
    """Questions over a link, as fast as this process can ask, and what was answered."""

    def __init__(self, session: zenoh.Session) -> None:
        self.asked = self.answers = self.answered_bytes = 0
        self._session = session
        self._handler = zenoh.handlers.Callback(self._take, indirect=False)

    def _take(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self.answers += 1
            self.answered_bytes += len(reply.ok.payload)

    def ask(self, key: str, payload: bytes | None = None) -> None:
        self.asked += 1
        self._session.get(key, self._handler, payload=payload, timeout=1.0)


@pytest.mark.parametrize("role", ["viewer", "laptop"])
@pytest.mark.requirement("CM_MR_02")
def test_a_flood_of_questions_refuses_no_permit_and_is_answered_within_bounds(keyed: KeyedMesh, role: str) -> None:
    keyed.go()
    with zenoh.open(session_config(keyed.by_tls(keyed.keys / role))) as session:
        flood = Flood(session)
        until(lambda: session.info.links(), what="the link")
        began_s, before = time.monotonic(), len(keyed.permits)

        def over() -> bool:
            for _ in range(100):
                for topic in (MAP, PLAN, STATUS["mmu"], PERMIT):
                    flood.ask(keyed.keyed(topic))
                flood.ask(keyed.keyed(MAP), bytes(10_000))
            return time.monotonic() - began_s > FLOOD_S

        until(over, what="the flood")
        permits = keyed.permits[before:]
        allowed_bytes = BURST_BYTES + RATE_BYTES_S * (time.monotonic() - began_s) if role == "laptop" else 0
        assert flood.answered_bytes <= allowed_bytes
        assert bool(flood.answers) == (role == "laptop")
    assert all(permit.granted for _, permit in permits), {permit.reason for _, permit in permits}
    assert max(later - earlier for (earlier, _), (later, _) in pairwise(permits)) < 3 / PERMIT_RATE_HZ
    assert flood.asked > 2_000


def own_address() -> str:
    """An address of this machine that others can reach; nothing is sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
        except OSError:
            pytest.skip("this machine has no network but loopback: connect it to one")
        address: str = probe.getsockname()[0]
        return address


def test_a_viewer_that_waits_to_be_found_is_not_connected_to_and_moves_nothing(keyed: KeyedMesh) -> None:
    keyed.stop()
    channel = replace(keyed.by_tls(keyed.keys / "viewer"), mode="peer", listen=(f"tcp/{own_address()}:0",))
    config = session_config(channel)
    config.insert_json5("scouting/gossip/enabled", "true")
    # What it could reach of a board's loopback from this very machine, it could not from another
    config.insert_json5("scouting/gossip/autoconnect", '{"peer": []}')
    with zenoh.open(config) as viewer:
        assert keyed.withstands(put_all(viewer, orders(keyed)))
        assert {str(link.src).split("/")[0] for link in viewer.info.links()} == {"tls"}


@pytest.mark.parametrize(
    ("what", "said"), [("none", "peer sent no certificates"), ("foreign", "invalid peer certificate")]
)
def test_without_a_certificate_of_the_authority_nobody_gets_in(
    keyed: KeyedMesh, tmp_path: Path, what: str, said: str
) -> None:
    keyed.stop()
    certificates.make_keys(tmp_path, HOSTS, replace=False, until=LATER)
    stranger = tmp_path / "command_center"
    shutil.copy(keyed.keys / "command_center" / AUTHORITY, stranger / AUTHORITY)
    config = session_config(keyed.by_tls(stranger))
    config.insert_json5("connect/timeout_ms", "500")
    if what == "none":
        tls = f'{{"root_ca_certificate": "{stranger / AUTHORITY}", "enable_mtls": false}}'
        config.insert_json5("transport/link/tls", tls)
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)
    assert keyed.standing
    keyed.await_complaints(said)


def test_an_unsigned_release_is_refused_even_with_the_right_certificate_and_on_the_board_itself(
    keyed: KeyedMesh,
) -> None:
    keyed.stop()
    commands = orders(keyed)[:2]
    for channel in (
        keyed.by_tls(keyed.keys / "command_center"),
        Channel("client", connect=(keyed.config.mesh.router,)),
    ):
        with zenoh.open(session_config(channel)) as session:
            assert keyed.withstands(put_all(session, commands))
        for module, topic in (("comm", STOP), ("bridge", STOP), ("planner", OPERATION)):
            keyed.await_complaints(f"a command was refused: it is not signed topic={topic.key}", by=module)


@pytest.fixture
def recorded(keyed: KeyedMesh) -> list[Signed]:
    """Release and resume as the rightful command center sent them a moment ago; the robot is stopped again."""
    heard: dict[tuple[str, bool], Signed] = {}

    def keep(sample: zenoh.Sample) -> None:
        signature = bytes(sample.attachment) if sample.attachment is not None else None
        heard[str(sample.key_expr), signature is not None] = (str(sample.key_expr), bytes(sample.payload), signature)

    def a_stop_was_heard() -> bool:
        keyed.go()
        keyed.stop()
        return (keyed.keyed(STOP), False) in heard

    with zenoh.open(session_config(keyed.by_tls(keyed.keys / "laptop"))) as laptop:
        ears = [laptop.declare_subscriber(keyed.keyed(topic), direct(keep)) for topic in (OPERATION, STOP)]
        until(a_stop_was_heard, what="the link to the command center")
        keyed.go()
        wanted = [(keyed.keyed(topic), True) for topic in (STOP, OPERATION)]
        until(lambda: all(command in heard for command in wanted), what="the commands")
        for ear in ears:
            ear.undeclare()
    keyed.stop()
    return [heard[command] for command in wanted]


def test_a_recorded_release_that_is_sent_again_does_nothing(keyed: KeyedMesh, recorded: list[Signed]) -> None:
    with zenoh.open(session_config(keyed.by_tls(keyed.keys / "command_center"))) as thief:
        assert keyed.withstands(put_all(thief, recorded))
    for module, topic in (("comm", STOP), ("planner", OPERATION)):
        text = f"a command was refused: it was obeyed already, and is sent again topic={topic.key}"
        keyed.await_complaints(text, by=module)


def test_a_planner_that_was_started_anew_obeys_no_recorded_command(keyed: KeyedMesh, recorded: list[Signed]) -> None:
    keyed.processes["planner"].kill()
    keyed.processes["planner"].wait()
    keyed.start("planner")
    with zenoh.open(session_config(keyed.by_tls(keyed.keys / "command_center"))) as thief:
        send = put_all(thief, recorded)
        until(lambda: send() or "planner" in keyed.bus.alive_tokens(), what="the planner")
        assert keyed.withstands(send)
    keyed.go()


def test_a_release_relayed_through_the_laptops_router_does_nothing(keyed: KeyedMesh, recorded: list[Signed]) -> None:
    with zenoh.open(session_config(Channel("client", connect=(keyed.config.mesh.laptop_router,)))) as relayed:
        assert keyed.withstands(put_all(relayed, [*orders(keyed), *recorded]))
    keyed.await_complaints(no_right("from=loopback", STOP), no_right("from=loopback", OPERATION), by="recorder")
    # And by a router that relays whatever it is told
    with zenoh.open(session_config(keyed.by_tls(keyed.keys / "laptop"))) as relay:
        assert keyed.withstands(put_all(relay, [*orders(keyed), *recorded]))
    keyed.await_complaints(no_right("certificate=laptop", STOP), no_right("certificate=laptop", OPERATION))


def test_missing_keys_are_one_sentence_and_exit_code_2(mesh: Mesh, tmp_path: Path) -> None:
    listening = replace(mesh.config.mesh, listen="tls/127.0.0.1:0", keys=str(tmp_path))
    mesh.config_file.write_text(config_text(replace(mesh.config, mesh=listening)), encoding="utf-8")
    result = mesh.command("node", "comm", "--log-dir", str(mesh.folder))
    assert result.returncode == 2
    assert "command_key is missing: make the keys" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
