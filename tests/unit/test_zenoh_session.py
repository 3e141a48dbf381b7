"""Who listens and who connects: everything on one machine as before, several machines by TLS."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from common.config import Config, MeshSection
from common.errors import StartError
from common.zenoh_session import Mode, command_way, main_way

certificates = pytest.importorskip("deploy.certificates", reason="pip install cryptography")
ROUTER, LAPTOP_ROUTER = MeshSection().router, MeshSection().laptop_router
LISTEN, ROBOT = "tls/0.0.0.0:7449", "tls/robot:7449"
MODULES = ("bridge", "mmu", "planner", "poi", "visualizer", "command_center", "simulator")


@pytest.fixture(scope="module")
def several(tmp_path_factory: pytest.TempPathFactory) -> Config:
    """One file for all machines."""
    keys: Path = tmp_path_factory.mktemp("keys")
    later = datetime.now(UTC) + timedelta(days=1)
    certificates.make_keys(keys, {"robot": ["robot"]}, replace=False, until=later)
    return Config(mesh=MeshSection(listen=LISTEN, robot=ROBOT, keys=str(keys)))


def test_without_keys_all_join_the_router_of_comm_on_loopback() -> None:
    config = Config()
    comm, recorder = main_way("comm", "router", config), main_way("recorder", "router", config)
    assert (comm.listen, comm.connect) == ((ROUTER,), ())
    assert (recorder.listen, recorder.connect) == ((LAPTOP_ROUTER,), (ROUTER,))
    for module in MODULES:
        way = main_way(module, "peer", config)
        assert (way.mode, way.connect) == ("peer", (ROUTER,))
        assert command_way(module, "peer", config) == (way if module in ("bridge", "command_center") else None)
    assert main_way("command_center", "client", config).connect == (ROUTER,)
    ways = [comm, recorder, *(main_way(module, "peer", config) for module in MODULES)]
    assert all(way.keys is None and way.rules is None for way in ways)


@pytest.mark.parametrize(
    ("module", "mode", "connect", "role"),
    [
        ("comm", "router", (), "robot"),
        ("bridge", "peer", (ROUTER,), None),
        ("planner", "peer", (ROUTER,), None),
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
    way = main_way(module, mode, several)
    assert way.connect == connect
    assert (way.keys.name if way.keys is not None else None) == role
    assert not any(endpoint.startswith("tls/") for endpoint in (*way.listen, *way.connect)) or role is not None
    # Whoever listens, or is found by neighbours, has rules
    assert way.rules is not None or not way.listen


def test_commands_go_straight_to_the_robot(several: Config) -> None:
    way = command_way("command_center", "peer", several)
    assert way is not None
    assert way.connect == (ROBOT,)
    assert way.listen == ()
    assert way.keys is not None
    assert way.keys.name == "command_center"
    bridge = command_way("bridge", "peer", several)
    assert bridge is not None
    assert bridge.connect == (ROUTER,)


def test_comm_listens_on_loopback_and_for_the_other_machines(several: Config) -> None:
    assert main_way("comm", "router", several).listen == (ROUTER, LISTEN)


def test_a_machine_without_its_keys_says_so(tmp_path: Path) -> None:
    config = Config(mesh=MeshSection(robot=ROBOT, keys=str(tmp_path)))
    with pytest.raises(StartError, match="copy the folder laptop here"):
        main_way("recorder", "router", config)
