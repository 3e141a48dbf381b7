"""What a board is and does now: one command there -> `Facts`. Changes nothing."""

from __future__ import annotations

import re
import shlex
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from common.config import Config
from deploy.boards import layout
from deploy.boards.layout import unit_name
from deploy.boards.ssh import BoardError, Connection
from deploy.boards.tree import debian_packages
from onboard.comm.permit_file import GRANTED, NAME

# One `key=value` a line. An old or strange system answers what it can
_PROBE = f"""
echo uname=$(uname -m)
echo debian=$(. /etc/os-release 2>/dev/null; echo "$VERSION_ID")
echo python=$({layout.PYTHON} -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)
folder={layout.HOME}; [ -d "$folder" ] || folder=/opt; [ -d "$folder" ] || folder=/
echo free_kb=$(df -Pk "$folder" | awk 'NR == 2 {{ print $4 }}')
echo user=$(id -un {layout.USER} 2>/dev/null)
echo release=$(basename "$(readlink {layout.CURRENT} 2>/dev/null)" 2>/dev/null)
echo good=$(cd {layout.RELEASES} 2>/dev/null && ls -t ./*/.ok 2>/dev/null | cut -d / -f 2)
systemctl is-active -q COMM 2>/dev/null && echo permit=$(cat {layout.RUNTIME}/{NAME} 2>/dev/null)
echo uptime_s=$(cut -d ' ' -f 1 /proc/uptime)
echo load=$(cut -d ' ' -f 1 /proc/loadavg)
echo temperature_mc=$(cat /sys/class/thermal/thermal_zone0/temp 2>/dev/null)
echo systemd=$(systemctl is-system-running 2>/dev/null)
for package in PACKAGES; do
  [ "$(dpkg-query -W -f '${{db:Status-Status}}' "$package" 2>/dev/null)" = installed ] || echo missing:$package=1
done
for unit in UNITS; do
  echo unit:$unit=$(systemctl show -p ActiveState -p NRestarts --value "$unit" 2>/dev/null)
done
for file in FILES; do [ -e "$file" ] && echo there:$file=1; done
true
"""
_RELEASE = re.compile(r"[A-Za-z0-9._-]+")


@dataclass(frozen=True, slots=True)
class Facts:
    """Empty texts and None where the board gave no answer."""

    platform: str
    debian: str
    python: str
    free_kb: int
    has_user: bool
    has_systemd: bool
    release: str
    good: tuple[str, ...]  # releases that ran well, the newest first
    permit: str
    uptime_s: float
    load: str
    temperature_deg: float | None
    clock_offset_s: float  # how far the board's clock is ahead of this machine's
    missing_packages: tuple[str, ...]
    units: Mapping[str, tuple[str, str]]  # name -> state of systemd, number of restarts
    files: frozenset[str]  # of those that were looked for

    def runs(self, release: str) -> bool:
        """That release, and every one of its services."""
        return release == self.release and all(state == "active" for state, _ in self.units.values())

    @property
    def may_move(self) -> bool:
        """comm runs, and has granted the permit to move."""
        return self.permit == GRANTED


def probe(connection: Connection, config: Config) -> Facts:
    """Of a board that is connected; raises BoardError."""
    board = connection.board
    units = [unit_name(process) for process in config.boards[board].processes]
    script = _PROBE
    for name, words in (
        ("COMM", [unit_name(config.process_of("comm"))]),
        ("PACKAGES", debian_packages(config, board)),
        ("UNITS", units),
        ("FILES", needed_files(config, board)),
    ):
        script = script.replace(name, shlex.join(words))
    return parse(connection.run(script), clock_offset_s(connection))


def needed_files(config: Config, board: str) -> list[str]:
    """Devices that the configuration names and the board must have, and its keys."""
    modules = layout.modules_on(config, board)
    files = [config.bridge.serial_port] if "bridge" in modules else []
    if "poi" in modules and config.poi.source.startswith("/dev/"):
        files.append(config.poi.source)
    return [file for file in files if file.startswith("/")]


def clock_offset_s(connection: Connection) -> float:
    """How far the board's clock is ahead (s), but for half of the time that the answer took."""
    before_s = time.time()
    text = connection.run("date +%s.%N")
    after_s = time.time()
    try:
        return float(text) - (before_s + after_s) / 2
    except ValueError:
        raise BoardError(f"{connection.board}: its `date` gives no seconds.") from None


def parse(text: str, offset_s: float) -> Facts:
    """The answer of a board."""
    pairs = {key: value for key, _, value in (line.partition("=") for line in text.splitlines())}
    units = {key.removeprefix("unit:"): _unit(value) for key, value in pairs.items() if key.startswith("unit:")}
    temperature = _number(pairs.get("temperature_mc", ""))
    return Facts(
        platform=pairs.get("uname", ""),
        debian=pairs.get("debian", ""),
        python=pairs.get("python", ""),
        free_kb=int(_number(pairs.get("free_kb", "")) or 0),
        has_user=bool(pairs.get("user")),
        has_systemd=pairs.get("systemd", "") not in ("", "offline"),
        release=pairs.get("release", ""),
        good=tuple(name for name in pairs.get("good", "").split() if _RELEASE.fullmatch(name)),
        permit=pairs.get("permit", ""),
        uptime_s=_number(pairs.get("uptime_s", "")) or 0.0,
        load=pairs.get("load", ""),
        temperature_deg=None if temperature is None else temperature / 1000.0,
        clock_offset_s=offset_s,
        missing_packages=_named("missing", pairs),
        units=units,
        files=frozenset(_named("there", pairs)),
    )


def _named(kind: str, pairs: Mapping[str, str]) -> tuple[str, ...]:
    return tuple(key.removeprefix(f"{kind}:") for key in pairs if key.startswith(f"{kind}:"))


def _unit(value: str) -> tuple[str, str]:
    words: Sequence[str] = value.split()
    restarts = next((word for word in words if word.isdigit()), "0")
    return next((word for word in words if not word.isdigit()), "unknown"), restarts


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
