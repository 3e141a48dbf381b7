"""A release onto a board: `deliver` puts it beside the others, `switch` makes it the running one, or goes back.

A release is complete or not there: it is sent into a folder that is renamed at the end, so a broken link leaves nothing
but that folder, with which the next push goes on. What the running release has already is linked, not sent.
"""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from deploy.boards import layout
from deploy.boards.ssh import BoardError, Connection, Sent, last_line
from deploy.boards.tree import Tree

SWITCH = Path(__file__).with_name("switch.sh")
LAST_GOOD = "-"
HEALTHY_S = 3.0  # for which every service must run without a restart, once all have started
_SWITCH_S = 900.0  # slow boards start slowly, and an earlier release may have to start as well
_COMPILE_S = 1800.0
_COMPILED = 1.5  # times the size of the sources, with Python's compiled files
_SPARE_BYTES = 16_000_000

_READABLE = "--chmod=D755,F644"  # whatever this machine's umask was


class Outcome(Enum):
    """How a switch ended: the exit codes of switch.sh."""

    RUNS = 0
    RETURNED = 3  # to an earlier release
    NOTHING_RUNS = 4
    NO_RELEASE = 5


@dataclass(frozen=True, slots=True)
class Switched:
    outcome: Outcome
    text: str  # the release that runs, or what went wrong


def is_there(connection: Connection, release: str) -> bool:
    """Has the board the whole release?"""
    return "yes" in connection.run(f"[ -d {layout.RELEASES}/{release} ] && echo yes || true")


def needed_bytes(connection: Connection, tree: Tree) -> int:
    """What the release takes of the board's disk."""
    if is_there(connection, tree.release):
        return 0
    files = sum(sent.file_bytes for sent in _send(connection, tree, "--dry-run"))
    return round(files * _COMPILED) + _SPARE_BYTES


def deliver(connection: Connection, tree: Tree) -> int:
    """Sends what is missing there, under a name that nothing uses yet; returns the bytes that went over the link."""
    part = _part(tree.release)
    connection.change(f"mkdir -p {part}/site")
    link_bytes = sum(sent.link_bytes for sent in _send(connection, tree))
    compile_all = f"cd {part} && {layout.PYTHON} -m compileall -q -j 1 app site >/dev/null 2>&1"
    connection.change(
        f"({compile_all}); sync -f . && mv -T {part} {layout.RELEASES}/{tree.release}",
        timeout_s=_COMPILE_S,
        what=f"compile it, then name it {tree.release}",
    )
    return link_bytes


def switch(connection: Connection, release: str) -> Switched:
    """Stops what runs, starts the release, watches it for a moment; where it does not run, the last good one again."""
    if connection.dry_run:
        connection.report(f"would switch to {'the last good release' if release == LAST_GOOD else release}")
        return Switched(Outcome.RUNS, release)
    script = SWITCH.read_text(encoding="utf-8") + f'\nmain "{release}" {HEALTHY_S:g}\n'
    words = connection.command("exec sh -s")
    done = subprocess.run(words, input=script, capture_output=True, text=True, timeout=_SWITCH_S, check=False)
    try:
        outcome = Outcome(done.returncode)
    except ValueError:
        why = last_line(done.stderr)
        raise BoardError(f"The link to {connection.board} broke while it switched to {release}: {why}.") from None
    complaints = " ".join(done.stdout.split("\n")[:-2] + done.stderr.splitlines()[:2])
    text = last_line(done.stdout)
    return Switched(outcome, text if outcome is Outcome.RUNS else f"{last_line(complaints)}; {text}")


def _part(release: str) -> str:
    return f"{layout.RELEASES}/{release}.part"


def _send(connection: Connection, tree: Tree, *options: str) -> tuple[Sent, Sent]:
    """Its own files by their content: they have no times that would mean anything. The packages by size and time."""
    part = _part(tree.release)
    own = ("--checksum", "--mkpath", _READABLE, f"--link-dest={layout.CURRENT}/")
    site = ("--mkpath", _READABLE, f"--link-dest={layout.CURRENT}/site/")
    return (
        connection.send(tree.own, part, *own, *options),
        connection.send(tree.site, f"{part}/site", *site, *options),
    )
