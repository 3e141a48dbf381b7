"""Who listens and who connects: everything on one machine as before, several machines by TLS."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from common.config import Config, MeshSection, apart
from common.errors import StartError
from common.modules import ON_ROBOT
from common.zenoh_channel import Channel, Mode, commander_channel
from common.zenoh_session import NEIGHBOURS, command_channel, main_channel

certificates = pytest.importorskip("deploy.boards.certificates", reason="pip install cryptography")
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
        channel = main_channel(module, "peer", config)
        assert channel.connect[0] == (ROUTER if module in (*ON_ROBOT, "command_center") else LAPTOP_ROUTER)
        assert (command_channel(module, "peer", config) is not None) == (module == "command_center")
    assert main_channel("command_center", "client", config).connect == (ROUTER,)
    channels = [comm, recorder, *(main_channel(module, "peer", config) for module in MODULES)]
    assert all(channel.keys is None and channel.rules is None for channel in channels)


def port_of(endpoint: str) -> str:
    return endpoint.rsplit(":", 1)[1]


def test_of_two_peers_just_one_connects_to_the_other_and_all_of_it_stays_on_loopback() -> None:
    config = apart(Config())
    commands = command_channel("command_center", "peer", config)
    assert commands is not None
    channels = [*(main_channel(module, "peer", config) for module in (*NEIGHBOURS, "stranger")), commands]
    for channel in channels:
        assert all(endpoint.startswith("tcp/127.0.0.") for endpoint in (*channel.listen, *channel.connect))
        assert {port_of(endpoint) for endpoint in (*channel.listen, *channel.connect)} == {port_of(ROUTER)}

    def connects(channel: Channel, other: Channel) -> bool:
        return bool(set(channel.connect) & set(other.listen))

    listening = [channel for channel in channels if channel.listen]
    assert len(listening) == len({channel.listen for channel in listening}) == len(NEIGHBOURS)
    for other in listening:
        assert all(connects(channel, other) != connects(other, channel) for channel in channels if channel is not other)


def test_who_shares_the_process_of_the_router_is_reached_there() -> None:
    bridge, poi = (main_channel(module, "peer", Config()) for module in ("bridge", "poi"))
    assert bridge.connect == (ROUTER,)
    assert poi.connect == (ROUTER, *bridge.listen)


def test_what_is_no_part_of_the_robot_reaches_it_through_the_router_of_the_laptop() -> None:
    for module in ("visualizer", "simulator", "local"):
        assert main_channel(module, "peer", Config()) == Channel("peer", connect=(LAPTOP_ROUTER,), region=module)


def test_meshes_with_routers_of_their_own_share_no_address() -> None:
    channels = [
        main_channel(module, "peer", Config(mesh=MeshSection(router)))
        for router in (ROUTER, LAPTOP_ROUTER)
        for module in ("bridge", "mmu")
    ]
    assert len({channel.listen for channel in channels}) == len(channels)


@pytest.mark.parametrize(
    ("module", "mode", "connect", "role"),
    [
        ("comm", "router", (), "robot"),
        ("bridge", "peer", (ROUTER,), None),
        ("poi", "peer", (ROBOT,), "pi"),
        ("recorder", "router", (ROBOT,), "laptop"),
        ("visualizer", "peer", (LAPTOP_ROUTER,), None),
        ("command_center", "peer", (LAPTOP_ROUTER,), None),
        ("command_center", "client", (ROBOT,), "command_center"),
    ],
)
def test_over_several_machines_the_certificate_is_shown_where_a_link_leaves_one(
    several: Config, module: str, mode: Mode, connect: tuple[str, ...], role: str | None
) -> None:
    channel = main_channel(module, mode, several)
    assert channel.connect == connect
    assert (channel.keys.name if channel.keys is not None else None) == role
    assert not any(endpoint.startswith("tls/") for endpoint in (*channel.listen, *channel.connect)) or role is not None
    # Whoever listens where others can come has rules
    assert channel.rules is not None or channel.mode != "router" or not channel.listen


def test_commands_go_straight_to_the_robot(several: Config) -> None:
    channel = command_channel("command_center", "peer", several)
    assert channel is not None
    assert channel.connect == (ROBOT,)
    assert channel.listen == ()
    assert channel.keys is not None
    assert channel.keys.name == "command_center"


def test_comm_listens_on_loopback_and_for_the_other_machines(several: Config) -> None:
    assert main_channel("comm", "router", several).listen == (ROUTER, LISTEN)


def test_a_stop_takes_the_channel_of_every_client_of_the_command_center(several: Config) -> None:
    for config in (several, Config()):
        assert commander_channel(config) == main_channel("command_center", "client", config)


def test_a_machine_without_its_keys_says_so(tmp_path: Path) -> None:
    config = Config(mesh=MeshSection(robot=ROBOT, keys=str(tmp_path)))
    with pytest.raises(StartError, match="copy the folder laptop here"):
        main_channel("recorder", "router", config)
