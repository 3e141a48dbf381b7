"""Who listens and who connects: everything on one machine as before, several machines by TLS."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from common.config import Config, MeshSection
from common.errors import StartError
from common.zenoh_session import NEIGHBOURS, Channel, Mode, command_channel, main_channel

certificates = pytest.importorskip("deploy.certificates", reason="pip install cryptography")
ROUTER, LAPTOP_ROUTER = MeshSection().router, MeshSection().laptop_router
LISTEN, ROBOT = "tls/0.0.0.0:7449", "tls/robot:7449"
MODULES = ("bridge", "mmu", "planner", "poi", "visualizer", "command_center", "simulator", "local")


@pytest.fixture(scope="module")
def several(tmp_path_factory: pytest.TempPathFactory) -> Config:
    """One file for all machines."""
    keys: Path = tmp_path_factory.mktemp("keys")
    later = datetime.now(UTC) + timedelta(days=1)
    certificates.make_keys(keys, {"robot": ["robot"]}, replace=False, until=later)
    return Config(mesh=MeshSection(listen=LISTEN, robot=ROBOT, keys=str(keys)))


def test_without_keys_all_join_the_router_of_comm_on_loopback() -> None:
    config = Config()
    comm, recorder = main_channel("comm", "router", config), main_channel("recorder", "router", config)
    assert (comm.listen, comm.connect) == ((ROUTER,), ())
    assert (recorder.listen, recorder.connect) == ((LAPTOP_ROUTER,), (ROUTER,))
    for module in MODULES:
        way = main_channel(module, "peer", config)
        assert (way.mode, way.connect[0]) == ("peer", ROUTER)
        assert (command_channel(module, "peer", config) is not None) == (module in ("bridge", "command_center"))
    assert main_channel("command_center", "client", config).connect == (ROUTER,)
    ways = [comm, recorder, *(main_channel(module, "peer", config) for module in MODULES)]
    assert all(way.keys is None and way.rules is None for way in ways)


def port_of(endpoint: str) -> str:
    return endpoint.rsplit(":", 1)[1]


def test_of_two_peers_just_one_connects_to_the_other_and_all_of_it_stays_on_loopback() -> None:
    config = Config()
    sessions = {module: main_channel(module, "peer", config) for module in (*MODULES, "stranger")}
    commands = [command_channel(module, "peer", config) for module in ("bridge", "command_center")]
    ways = [*sessions.values(), *(way for way in commands if way is not None)]
    for way in ways:
        assert all(endpoint.startswith("tcp/127.0.0.") for endpoint in (*way.listen, *way.connect))
        assert {port_of(endpoint) for endpoint in (*way.listen, *way.connect)} == {port_of(ROUTER)}

    def connects(way: Channel, other: Channel) -> bool:
        return bool(set(way.connect) & set(other.listen))

    listening = [way for way in ways if way.listen]
    assert len(listening) == len({way.listen for way in listening}) == len(NEIGHBOURS)
    for other in listening:
        assert all(connects(way, other) != connects(other, way) for way in ways if way is not other)


def test_meshes_with_routers_of_their_own_share_no_address() -> None:
    ways = [
        main_channel(module, "peer", Config(mesh=MeshSection(router)))
        for router in (ROUTER, LAPTOP_ROUTER)
        for module in ("bridge", "mmu")
    ]
    assert len({way.listen for way in ways}) == len(ways)


@pytest.mark.parametrize(
    ("module", "mode", "connect", "role"),
    [
        ("comm", "router", (), "robot"),
        ("bridge", "peer", (ROUTER, "tcp/127.0.0.2:7447"), None),
        ("poi", "peer", (ROBOT,), "pi"),
        ("recorder", "router", (ROBOT,), "laptop"),
        ("visualizer", "peer", (LAPTOP_ROUTER,), None),
        ("command_center", "peer", (LAPTOP_ROUTER, "tcp/127.0.0.8:7448"), None),
        ("command_center", "client", (ROBOT,), "command_center"),
    ],
)
def test_over_several_machines_the_certificate_is_shown_where_a_link_leaves_one(
    several: Config, module: str, mode: Mode, connect: tuple[str, ...], role: str | None
) -> None:
    way = main_channel(module, mode, several)
    assert way.connect == connect
    assert (way.keys.name if way.keys is not None else None) == role
    assert not any(endpoint.startswith("tls/") for endpoint in (*way.listen, *way.connect)) or role is not None
    # Whoever listens where others can come has rules
    assert way.rules is not None or way.mode != "router" or not way.listen


def test_commands_go_straight_to_the_robot(several: Config) -> None:
    way = command_channel("command_center", "peer", several)
    assert way is not None
    assert way.connect == (ROBOT,)
    assert way.listen == ()
    assert way.keys is not None
    assert way.keys.name == "command_center"
    bridge = command_channel("bridge", "peer", several)
    assert bridge is not None
    assert bridge.connect == (ROUTER,)
    assert bridge.listen == ("tcp/127.0.0.2:7447",)


def test_comm_listens_on_loopback_and_for_the_other_machines(several: Config) -> None:
    assert main_channel("comm", "router", several).listen == (ROUTER, LISTEN)


def test_a_machine_without_its_keys_says_so(tmp_path: Path) -> None:
    config = Config(mesh=MeshSection(robot=ROBOT, keys=str(tmp_path)))
    with pytest.raises(StartError, match="copy the folder laptop here"):
        main_channel("recorder", "router", config)
