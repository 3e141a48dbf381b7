"""A booted container as a board that `deploy` reaches, instead of over ssh."""

from __future__ import annotations

import os
import subprocess
from dataclasses import replace
from pathlib import Path

from common.config import Config
from deploy.boards.probe import Facts, probe
from deploy.boards.ssh import Connection, Sent
from tests.system.container import Container

PACKAGES = ("systemd-sysv", "dbus", "python3")
CONFIG = replace(Config(), beaglebone=replace(Config().beaglebone, platform=os.uname().machine))


class Inside(Connection):
    """Into a container instead of over ssh."""

    def __init__(self, container: Container) -> None:
        self.lines: list[str] = []
        super().__init__("beaglebone", "container", self.lines.append)
        self._enter = ["nsenter", "-t", str(container._leader), "-m", "-u", "-i", "-n", "-p"]

    def command(self, words: str) -> list[str]:
        return [*self._enter, "sh", "-c", words]

    def send(self, source: Path, target: str, *options: str) -> Sent:
        packed = subprocess.run(["tar", "c", "-C", source, "."], capture_output=True, check=True).stdout
        self.run(f"mkdir -p {target} && tar x -C {target} --no-same-owner", packed)
        return Sent(len(packed), len(packed))

    def facts(self) -> Facts:
        return probe(self, CONFIG)
