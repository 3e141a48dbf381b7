"""An IP link to a machine of its own: a network namespace behind a pair of TUN devices, with this program in between.

It can lose packets, be late, and be gone without a word to anybody, as a radio is. Needs root, for the namespace.
"""

from __future__ import annotations

import fcntl
import heapq
import os
import random
import select
import shutil
import struct
import subprocess
import threading
import time
from contextlib import suppress
from itertools import count

import pytest

_TUN = "/dev/net/tun"
_SET_INTERFACE = 0x400454CA  # TUNSETIFF
_TUN_WITHOUT_HEADER = 0x1001  # IFF_TUN | IFF_NO_PI
_PACKET_BYTES = 2048
_NAMES = count()


class Radio:
    """`here` and `there` are the addresses of its ends; a command that begins with `enter` runs on the far machine."""

    def __init__(self, seed: int = 0) -> None:
        number = next(_NAMES)
        name = f"im{os.getpid()}x{number}"
        net = f"10.{201 + os.getpid() % 50}.{(os.getpid() // 50 + number) % 250}"
        self.here, self.there = f"{net}.1", f"{net}.2"
        self.enter = ("ip", "netns", "exec", name)
        self.up, self.loss, self.delay_s = True, 0.0, 0.0
        self._name = name
        self._chance = random.Random(seed)
        self._ends = tuple(_open_tun(device) for device in (f"{name}a", f"{name}b"))
        for command in (
            f"ip netns add {name}",
            f"ip link set {name}b netns {name}",
            f"ip addr add {self.here}/24 dev {name}a",
            f"ip link set {name}a up",
            f"ip -n {name} addr add {self.there}/24 dev {name}b",
            f"ip -n {name} link set {name}b up",
            f"ip -n {name} link set lo up",
        ):
            subprocess.run(command.split(), check=True)
        self._woken, self._wake = os.pipe()
        self._thread = threading.Thread(target=self._carry, daemon=True)
        self._thread.start()

    def close(self) -> None:
        os.write(self._wake, b"x")
        self._thread.join()
        for end in (*self._ends, self._woken, self._wake):
            os.close(end)
        subprocess.run(["ip", "netns", "delete", self._name], check=True)

    def _carry(self) -> None:
        here, there = self._ends
        late: list[tuple[float, int, int, bytes]] = []
        numbers = count()
        while True:
            wait_s = max(0.0, late[0][0] - time.monotonic()) if late else None
            readable, _, _ = select.select([here, there, self._woken], [], [], wait_s)
            if self._woken in readable:
                return
            for source in readable:
                packet = os.read(source, _PACKET_BYTES)
                if self.up and self._chance.random() >= self.loss:
                    sink = there if source == here else here
                    heapq.heappush(late, (time.monotonic() + self.delay_s, next(numbers), sink, packet))
            while late and late[0][0] <= time.monotonic():
                _, _, sink, packet = heapq.heappop(late)
                with suppress(OSError):  # a device that is down, or full
                    os.write(sink, packet)


def _open_tun(device: str) -> int:
    end = os.open(_TUN, os.O_RDWR)
    fcntl.ioctl(end, _SET_INTERFACE, struct.pack("16sH", device.encode(), _TUN_WITHOUT_HEADER))
    return end


def open_radio() -> Radio:
    """Skips the test where there can be none."""
    if shutil.which("ip") is None:
        pytest.skip("without ip there are no network namespaces: apt-get install iproute2")
    if os.geteuid() != 0 or not os.path.exists(_TUN):
        pytest.skip("only root can make a network namespace: run the tests with sudo, or in a container")
    return Radio()
