"""A network of machines around one switch: namespaces on a bridge, each on a cable of its own that can be pulled.

The laptop is this machine. Needs root.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from itertools import count

import pytest

_NAMES = count()


def _ip(words: str) -> None:
    subprocess.run(["ip", *words.split()], check=True)


class Plug:
    """A machine's cable: `there` is its address; a command that begins with `enter` runs on that machine."""

    def __init__(self, switch: str, machine: str, address: str) -> None:
        self.there = address
        self.enter = ("ip", "netns", "exec", machine)
        self._switch, self._machine, self._end = switch, machine, f"{machine}a"
        self._up = True
        for words in (
            f"netns add {machine}",
            f"-n {switch} link add {machine}a type veth peer name {machine}b netns {machine}",
            f"-n {switch} link set {machine}a master hub up",
            f"-n {machine} addr add {address}/24 dev {machine}b",
            f"-n {machine} link set {machine}b up",
            f"-n {machine} link set lo up",
        ):
            _ip(words)

    @property
    def up(self) -> bool:
        """Is the cable plugged in? Both ends see when it is not."""
        return self._up

    @up.setter
    def up(self, plugged: bool) -> None:
        self._up = plugged
        _ip(f"-n {self._switch} link set {self._end} {'up' if plugged else 'down'}")

    def close(self) -> None:
        _ip(f"netns delete {self._machine}")


class Switch:
    """`here`: the laptop's address."""

    def __init__(self) -> None:
        number = next(_NAMES)
        self._name = f"im{os.getpid()}s{number}"
        self._net = f"10.{151 + os.getpid() % 50}.{(os.getpid() // 50 + number) % 250}"
        self.here = f"{self._net}.1"
        self._plugs = count(2)
        for words in (
            f"netns add {self._name}",
            f"-n {self._name} link add hub type bridge",
            f"-n {self._name} link set hub up",
            f"link add {self._name} type veth peer name laptop netns {self._name}",
            f"-n {self._name} link set laptop master hub up",
            f"addr add {self.here}/24 dev {self._name}",
            f"link set {self._name} up",
        ):
            _ip(words)

    def plug(self) -> Plug:
        """A machine more."""
        number = next(self._plugs)
        return Plug(self._name, f"{self._name}{number}", f"{self._net}.{number}")

    def close(self) -> None:
        """After all of its machines."""
        _ip(f"link delete {self._name}")
        _ip(f"netns delete {self._name}")


def open_switch() -> Switch:
    """Skips the test where there can be none."""
    if shutil.which("ip") is None:
        pytest.skip("without ip there are no network namespaces: apt-get install iproute2")
    if os.geteuid() != 0:
        pytest.skip("only root can make a network namespace: run the tests with sudo, or in a container")
    return Switch()
