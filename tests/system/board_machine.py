"""A board to deploy to: a copy of this machine's files on top of them, a network and processes of its own, and sshd.

What it writes lies in memory and goes with it. systemd, apt and dpkg are stand-ins. Needs root.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

import pytest

from tests.system.radio import open_radio

FAKE_SYSTEMCTL = Path(__file__).with_name("fake_systemctl.py")
MOUNT = """
set -e
mount -t tmpfs tmpfs {top}
mkdir {top}/upper {top}/work {top}/root
mount -t overlay overlay -o lowerdir=/,upperdir={top}/upper,workdir={top}/work {top}/root
cp -a {files}/. {top}/root/
mount -t proc proc {top}/root/proc
mount --rbind /dev {top}/root/dev
mount -t tmpfs tmpfs {top}/root/dev/shm
mount -t tmpfs tmpfs {top}/root/run
mkdir {top}/root/run/sshd
mount -t tmpfs -o size={opt_mb}m tmpfs {top}/root/opt
exec chroot {top}/root /usr/sbin/sshd -D -e -f /etc/board_sshd
"""
SSHD = """
Port 22
HostKey /etc/board_key
AuthorizedKeysFile /etc/board_authorized
PermitRootLogin yes
UsePAM no
StrictModes no
PidFile none
Subsystem sftp internal-sftp
"""
CLIENT = """
Host {name} {address}
  HostName {address}
  User root
  IdentityFile {key}
  IdentitiesOnly yes
  StrictHostKeyChecking no
  UserKnownHostsFile /dev/null
  LogLevel ERROR
"""
# dpkg-query knows what apt-get has installed, and everything but what a test says is missing
DPKG_QUERY = """#!/bin/sh
for package; do :; done
grep -qx "$package" /etc/board_missing 2>/dev/null || echo installed
"""
APT_GET = """#!/bin/sh
echo "$@" >> /etc/board_apt
case "$*" in *install*) : > /etc/board_missing;; esac
"""


class Link(Protocol):
    """A `Radio`, or the `Plug` of a `Switch`."""

    up: bool
    there: str
    enter: tuple[str, ...]

    def close(self) -> None: ...


class BoardMachine:
    """`link` leads to it; `name` is what `ssh` takes."""

    def __init__(self, name: str, folder: Path, link: Link, opt_mb: int = 600) -> None:
        self.name, self.link = name, link
        self._files, self._top = folder / f"{name}.files", folder / f"{name}.top"
        self._top.mkdir()
        key = folder / f"{name}.key"
        for file in (key, folder / f"{name}.host"):
            subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", file], check=True)
        for path, text, mode in (
            ("etc/board_sshd", SSHD, 0o644),
            ("etc/board_key", (folder / f"{name}.host").read_text(), 0o600),
            ("etc/board_authorized", key.with_suffix(".key.pub").read_text(), 0o644),
            ("usr/bin/systemctl", FAKE_SYSTEMCTL.read_text(), 0o755),
            ("usr/bin/journalctl", FAKE_SYSTEMCTL.read_text(), 0o755),
            ("usr/bin/dpkg-query", DPKG_QUERY, 0o755),
            ("usr/bin/apt-get", APT_GET, 0o755),
        ):
            target = self._files / path
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(text)
            target.chmod(mode)
        script = MOUNT.format(top=self._top, files=self._files, opt_mb=opt_mb)
        self.log = (folder / f"{name}.log").open("wb")
        self._process = subprocess.Popen(
            [*link.enter, "unshare", "--mount", "--pid", "--fork", "--kill-child", "sh", "-c", script],
            stdout=self.log,
            stderr=self.log,
        )
        self.client = CLIENT.format(name=name, address=link.there, key=key)

    def await_answer(self) -> None:
        end_s = time.monotonic() + 20.0
        while subprocess.run(["ssh", self.name, "true"], capture_output=True, check=False).returncode != 0:
            assert time.monotonic() < end_s, Path(self.log.name).read_text()
            time.sleep(0.1)

    def run(self, words: str) -> str:
        """A command there."""
        return subprocess.run(["ssh", self.name, words], capture_output=True, text=True, check=True).stdout

    def close(self) -> None:
        self.link.up = True
        self._process.send_signal(signal.SIGKILL)  # with it all processes of its own
        self._process.wait()
        self.log.close()
        self.link.close()


def _needs() -> None:
    for program, package in (("sshd", "openssh-server"), ("rsync", "rsync"), ("unshare", "util-linux")):
        if shutil.which(program, path=f"{os.environ['PATH']}:/usr/sbin") is None:
            pytest.skip(f"without {program} there is no board: apt-get install {package}")


@contextmanager
def board_machines(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    *names: str,
    opt_mb: int = 600,
    open_link: Callable[[], Link] = open_radio,
) -> Iterator[list[BoardMachine]]:
    """Boards that `ssh NAME` reaches; skips the test where there can be none."""
    _needs()
    machines: list[BoardMachine] = []
    try:
        for name in names:
            machines.append(BoardMachine(name, folder, open_link(), opt_mb))
        config, programs = folder / "ssh_config", folder / "programs"
        config.write_text("".join(machine.client for machine in machines))
        programs.mkdir()
        wrapper = programs / "ssh"
        wrapper.write_text(f'#!/bin/sh\nexec {shutil.which("ssh")} -F {config} "$@"\n')
        wrapper.chmod(0o755)
        monkeypatch.setenv("PATH", f"{programs}:{os.environ['PATH']}")
        for machine in machines:
            machine.await_answer()
        yield machines
    finally:
        for machine in machines:
            machine.close()
