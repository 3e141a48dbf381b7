"""Ports of meshes: none is given twice, and none whose addresses somebody uses."""

from __future__ import annotations

import socket
import subprocess
import sys

import pytest

from common.zenoh_session import PEER_HOSTS
from deploy.local.ports import reserve_port
from tests.architecture.project import ROOT

RESERVE = "import sys; from deploy.local.ports import reserve_port; print(reserve_port(int(sys.argv[1])))"


def reserved_elsewhere(wanted: int) -> int:
    """What another process gets that wants this port."""
    command = [sys.executable, "-c", RESERVE, str(wanted)]
    return int(subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout)


def test_a_port_that_is_wanted_and_free_is_given() -> None:
    free = reserved_elsewhere(reserve_port())
    assert reserve_port(free) == free


def test_a_port_is_given_to_no_other_process_while_nothing_listens_there_yet() -> None:
    port = reserve_port()
    assert reserved_elsewhere(port) != port


@pytest.mark.parametrize("host", ["127.0.0.1", PEER_HOSTS[0], PEER_HOSTS[-1]])
def test_a_port_at_which_a_process_of_another_mesh_still_listens_is_not_given(host: str) -> None:
    free = reserved_elsewhere(reserve_port())
    with socket.socket() as other:
        other.bind((host, free))
        other.listen()
        assert reserve_port(free) != free
