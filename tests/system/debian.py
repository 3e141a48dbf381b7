"""Debian's own root folders, for tests of what runs on the boards: made once by mmdebstrap, kept in the user's cache.

They need root, and Debian's packages mmdebstrap and, for a BeagleBone, qemu-user-static and binfmt-support.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "indoor-mapping"
MIRROR = os.environ.get("DEBIAN_MIRROR", "http://deb.debian.org/debian")
_BINFMT = Path("/proc/sys/fs/binfmt_misc")
_HANDLER = "qemu-arm"


def need(*tools: str) -> None:
    """Skips the test where it cannot run, with the line that helps."""
    if os.geteuid() != 0:
        pytest.skip("needs root")
    missing = [tool for tool in tools if shutil.which(tool.partition("=")[0]) is None]
    if missing:
        pytest.skip(f"needs: apt install {' '.join(tool.rpartition('=')[2] for tool in missing)}")


def need_arm() -> None:
    """Skips the test where this machine runs no programs of a BeagleBone."""
    need("qemu-arm-static=qemu-user-static", "update-binfmts=binfmt-support")
    if not (_BINFMT / _HANDLER).exists():
        if not (_BINFMT / "register").exists():
            subprocess.run(["mount", "-t", "binfmt_misc", "binfmt_misc", _BINFMT], check=False)
        subprocess.run(["update-binfmts", "--enable", _HANDLER], capture_output=True, check=False)
    if not (_BINFMT / _HANDLER).exists():
        pytest.skip("needs binfmt_misc in the kernel")


def debian_root(architecture: str, suite: str, packages: tuple[str, ...]) -> Path:
    """From the cache, or made: some minutes. Nothing may be written into it: see `over`."""
    need("mmdebstrap")
    holds = hashlib.sha256(",".join(packages).encode()).hexdigest()[:8]
    root = CACHE / "roots" / f"{architecture}-{suite}-{holds}"
    root.parent.mkdir(parents=True, exist_ok=True)
    with _alone(root.parent / f"{root.name}.lock"):
        if not root.exists():
            half = root.with_name(f"{root.name}.part")
            shutil.rmtree(half, ignore_errors=True)
            options = ("--variant=minbase", f"--include={','.join(packages)}", "--skip=check/qemu")
            command = ["mmdebstrap", f"--architectures={architecture}", *options, suite, half, MIRROR]
            made = subprocess.run(
                command, capture_output=True, text=True, check=False, env=os.environ | {"LC_ALL": "C"}
            )
            assert made.returncode == 0, made.stderr[-2000:]
            half.rename(root)
    return root


@contextmanager
def over(root: Path, folder: Path) -> Iterator[Path]:
    """The root with a layer of its own on top, below `folder`: what is written goes with the test."""
    upper, work, merged = (folder / name for name in ("upper", "work", "merged"))
    for made in (upper, work, merged):
        made.mkdir()
    layers = f"lowerdir={root},upperdir={upper},workdir={work}"
    subprocess.run(["mount", "-t", "overlay", "overlay", "-o", layers, merged], check=True)
    try:
        yield merged
    finally:
        subprocess.run(["umount", "--lazy", merged], check=True)


class Chroot:
    """Runs programs in a root folder, in a network and with processes of its own; all of them end with the first."""

    def __init__(self, root: Path, shown: dict[Path, str]) -> None:
        """`shown`: folder here -> path inside."""
        self.root = root
        inside = {source: root / path.lstrip("/") for source, path in shown.items()}
        for folder in inside.values():
            folder.mkdir(parents=True, exist_ok=True)
        mounts = [f"mount -t proc proc {root}/proc", f"mount --rbind /dev {root}/dev"]
        mounts += [f"mount --bind {source} {folder}" for source, folder in inside.items()]
        self._set_up = " && ".join(["ip link set lo up", *mounts])

    def run(self, *words: str, timeout_s: float, **environment: str) -> subprocess.CompletedProcess[str]:
        names = [
            f"{name}={value}" for name, value in ({"PATH": "/usr/bin:/bin", "LC_ALL": "C.UTF-8"} | environment).items()
        ]
        inside = ["unshare", "--mount", "--net", "--pid", "--fork", "--kill-child", "bash", "-c"]
        script = f'{self._set_up} && exec chroot {self.root} env -i "$@"'
        command = [*inside, script, "_", *names, *words]
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=timeout_s)


@contextmanager
def _alone(file: Path) -> Iterator[None]:
    with file.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
