"""The system's ssh and rsync: runs commands on a board as root, and sends files there. No agent on the board.

All commands to a board share one connection (ControlMaster). `run` looks, `change` changes: with `dry_run` a change is
only shown.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from common.errors import StartError
from common.plain_text import plain

Output = Callable[[str], None]

CONNECT_S = 10
PROGRESS_S = 10.0  # so often a long transfer is reported
ALIVE_S = 5  # three times that without a sign of the board, and the link counts as cut
_CUT = 255  # exit code of ssh itself
_RSYNC_CUT = (10, 12, 30, 35, 255)  # of rsync: the link, not the disk
# A user who is not root needs sudo without a password
_AS_ROOT = '$( [ "$(id -u)" = 0 ] || echo sudo -n )'
_PROGRESS = re.compile(r"\s*[\d,.]+\S*\s+(\d+%)")
_LINK_BYTES = re.compile(r"Total bytes sent: ([\d,.]+)")
_FILE_BYTES = re.compile(r"Total transferred file size: ([\d,.]+)")


class BoardError(StartError):
    """A command failed on a board: one sentence."""


class Unreachable(BoardError):
    """The board does not answer."""


@dataclass(frozen=True, slots=True)
class Sent:
    """What rsync counted."""

    link_bytes: int  # over the link
    file_bytes: int  # of the files that were new or differed


def _first_complaint(text: str) -> str:
    """Of rsync: the last ones are about its own end."""
    lines = [line for line in text.splitlines() if line.startswith("rsync")] or text.splitlines()
    return last_line(lines[0] if lines else "")


def _number(pattern: re.Pattern[str], text: str) -> int:
    found = pattern.search(text)
    return int(re.sub(r"\D", "", found[1])) if found else 0


def last_line(text: str) -> str:
    """What a program wrote last, for the end of a sentence."""
    lines = [line for line in text.strip().splitlines() if line.strip()]
    return plain(lines[-1].strip().rstrip("."), 300) if lines else "it gave no reason"


class Connection:
    """To one board, for as long as the `with` lasts. `report` shows a line to the person."""

    def __init__(self, board: str, address: str, report: Output, *, dry_run: bool = False) -> None:
        self.board, self.address, self.dry_run = board, address, dry_run
        self._report = report
        self._sockets = tempfile.TemporaryDirectory(prefix="indoor-mapping-")

    def __enter__(self) -> Connection:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Ends the shared connection."""
        subprocess.run([*self._ssh(), "-O", "exit", self.address], capture_output=True, check=False)
        self._sockets.cleanup()

    def report(self, line: str) -> None:
        """A line about this board."""
        self._report(f"{self.board}: {line}")

    def command(self, words: str) -> list[str]:
        """What runs `words` there in a shell, as root."""
        return [*self._ssh(), self.address, f"{_AS_ROOT} sh -c {shlex.quote(words)}"]

    def run(self, words: str, data: bytes = b"", timeout_s: float = 120.0) -> str:
        """Its output; raises Unreachable, and BoardError for an exit code other than 0."""
        try:
            done = subprocess.run(self.command(words), input=data, capture_output=True, timeout=timeout_s, check=False)
        except subprocess.TimeoutExpired:
            raise Unreachable(f"{self.board} ({self.address}) has not answered for {timeout_s:.0f} s.") from None
        complaint = done.stderr.decode(errors="replace")
        if done.returncode == _CUT:
            raise Unreachable(f"{self.board} ({self.address}) cannot be reached by ssh: {last_line(complaint)}.")
        output = done.stdout.decode(errors="replace")
        if done.returncode != 0:
            raise BoardError(f"{self.board}: {last_line(complaint or output)}.")
        return output

    def change(self, words: str, data: bytes = b"", timeout_s: float = 120.0, what: str = "") -> str:
        """As `run`; with `dry_run` it is only shown, by `what` where the words are many."""
        if self.dry_run:
            self.report(f"would run: {what or words}")
            return ""
        return self.run(words, data, timeout_s)

    def send(self, source: Path, target: str, *options: str) -> Sent:
        """What is in a folder -> into the folder `target`, by rsync; the option "--dry-run" only counts."""
        if self.dry_run:
            options = (*options, "--dry-run")
        arguments = [
            *("rsync", "--archive", "--no-owner", "--no-group", "--stats", "--info=progress2", "--partial"),
            *(f"--timeout={4 * ALIVE_S}", "--rsync-path", f"{_AS_ROOT} rsync", "-e", shlex.join(self._ssh())),
            *options,
            f"{source}/",
            f"{self.address}:{target}/",
        ]
        with tempfile.TemporaryFile("w+", errors="replace") as complaints:
            with subprocess.Popen(
                arguments, stdout=subprocess.PIPE, stderr=complaints, text=True, errors="replace"
            ) as rsync:
                assert rsync.stdout is not None
                output = "".join(self._watched(rsync.stdout))
            complaints.seek(0)
            why = _first_complaint(complaints.read())
        if rsync.returncode in _RSYNC_CUT:
            raise Unreachable(f"The link to {self.board} broke while it was sent {source.name}: {why}.")
        if rsync.returncode != 0:
            raise BoardError(f"{self.board} did not take {source.name}: {why}.")
        return Sent(*(_number(pattern, output) for pattern in (_LINK_BYTES, _FILE_BYTES)))

    def _watched(self, lines: Iterable[str]) -> Iterator[str]:
        """The lines of rsync, of which those on its progress are reported now and then."""
        due_s = time.monotonic() + PROGRESS_S
        for line in lines:
            progress = _PROGRESS.match(line)
            if progress is not None and time.monotonic() >= due_s:
                due_s = time.monotonic() + PROGRESS_S
                self.report(f"{progress[1]} of what is new is there")
            yield line

    def _ssh(self) -> Sequence[str]:
        return (
            *("ssh", "-o", "BatchMode=yes", "-o", f"ConnectTimeout={CONNECT_S}"),
            *("-o", f"ServerAliveInterval={ALIVE_S}", "-o", "ServerAliveCountMax=3"),
            *("-o", "ControlMaster=auto", "-o", "ControlPersist=60", "-o", f"ControlPath={self._sockets.name}/%C"),
        )
