"""Zenoh's own log -> the process's log, and with it the command center: only Zenoh knows what its access rules refuse.

Zenoh writes to standard output alone; that leads into a file in memory, which never keeps it waiting and is read in the
node's loop. The log lists every decision of the access rules; only the refusals are passed on.
"""

from __future__ import annotations

import fcntl
import logging
import os
import re
from collections import OrderedDict

from common.messages.topics import TOPICS
from common.repeats import Repeats

_RULES = "zenoh::net::routing::interceptor::access_control"
# Errors, who is refused for his certificate, whose link the rules do not know
OF_A_PEER = f"error,zenoh_link_tls=warn,{_RULES}=info"
# And every message that the rules refuse
OF_A_ROUTER = f"error,zenoh_link_tls=warn,{_RULES}=trace"

_READ_BYTES = 16_384  # at a time, ten times what a router logs about ordinary messages: a flood must not stop the loop
_FILE_BYTES = 1_000_000  # read; then it is emptied, with what nobody could follow
_LINKS_KEPT = 256
_STDOUT = 1

_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_LINE = re.compile(r"\S+ +(?P<level>ERROR|WARN|INFO) .*?(?P<source>zenoh\w*)\S*: (?P<text>.*?)(?: at /\S+)?$")
_REFUSAL = re.compile(
    r"(?P<thread>ThreadId\(\d+\)) \S+: (?:Using cached result: )?(?P<link>\w+)(?: on (?P<subject>\S+))?"
    r" is unauthorized to (?P<act>Put|Reply) \(ingress\) on [^/\s]+/(?P<key>\S+)"
)
# Zenoh writes it for every message that comes with a time from too far ahead. It passes the message on all the same
_CLOCKS_APART = re.compile(r"timestamp from \S+ exceeding delta")
_CLOCKS_PERIOD_S = 3600.0
_CERTIFICATE = re.compile(r"CertCommonName\((\w+)\)")
_NUMBER = re.compile(r"[0-9a-f]*\d[0-9a-f]*")
_KEYS = frozenset(key for topic in TOPICS for key in (topic.key, topic.bundle_key))

_log = logging.getLogger("zenoh")


class ZenohLog:
    """Picks from Zenoh's lines those that people need."""

    def __init__(self) -> None:
        self._repeats = Repeats()
        self._clock_repeats = Repeats(_CLOCKS_PERIOD_S)
        self._speakers: OrderedDict[str, str] = OrderedDict()  # Zenoh's id of who is linked -> what he is known by
        self._rights: dict[str, tuple[str, str]] = {}  # thread -> id and key whose rights it may be working out
        self._partial_line = ""

    def receive(self, written: str, now_s: float) -> None:
        """The next piece of what Zenoh wrote; a line may be cut anywhere."""
        *lines, self._partial_line = (self._partial_line + written).split("\n")
        for coloured in lines:
            if "TRACE" in coloured and "unauthorized" not in coloured:
                continue
            line = _COLOUR.sub("", coloured)
            if refusal := _REFUSAL.search(line):
                self._receive_refusal(refusal, now_s)
            elif _CLOCKS_APART.search(line):
                self._warn_of_clocks(now_s)
            elif found := _LINE.match(line):
                self._log_repeated(
                    logging.getLevelNamesMapping()[found["level"]], f"{found['source']}: {found['text']}", now_s
                )

    def _receive_refusal(self, refusal: re.Match[str], now_s: float) -> None:
        link, key, thread = refusal["link"], refusal["key"], refusal["thread"]
        if refusal["subject"] and link not in self._speakers:
            certificate = _CERTIFICATE.search(refusal["subject"])
            self._speakers[link] = f"certificate={certificate[1]}" if certificate else "from=loopback"
            if len(self._speakers) > _LINKS_KEPT:
                self._speakers.popitem(last=False)
        # When a link declares a key, all rights are worked out in one go, to reply before to put: nothing was sent yet
        if refusal["act"] == "Reply":
            self._rights[thread] = link, key
        elif self._rights.pop(thread, None) != (link, key):
            topic = key if key in _KEYS else "other"
            speaker = self._speakers.get(link, "from=unknown")
            self._log_repeated(
                logging.WARNING, f"a message was refused: it has no right to it {speaker} topic={topic}", now_s
            )

    def _warn_of_clocks(self, now_s: float) -> None:
        if self._clock_repeats.count("apart", now_s):
            _log.warning(
                "the clock of another machine is ahead of this one's by more than half a second: messages arrive all "
                "the same, but times in logs do not fit together; `indoor-mapping deploy clock` prints by how much"
            )

    def _log_repeated(self, level: int, text: str, now_s: float) -> None:
        count = self._repeats.count(_NUMBER.sub("", text), now_s)
        if count:
            _log.log(level, "%s count=%d", text, count)


class ZenohOutput:
    """From its making on, this process's standard output as a file in memory, and what Zenoh writes there."""

    def __init__(self) -> None:
        self._log = ZenohLog()
        self._file = os.memfd_create("stdout")
        fcntl.fcntl(self._file, fcntl.F_SETFL, os.O_APPEND)
        os.dup2(self._file, _STDOUT)
        self._read_bytes = 0

    def report(self, now_s: float) -> None:
        """Logs what was written since the last call, or a part of it."""
        written = os.pread(self._file, _READ_BYTES, self._read_bytes)
        if not written:
            return
        self._log.receive(written.decode(errors="replace"), now_s)
        self._read_bytes += len(written)
        if self._read_bytes >= _FILE_BYTES:
            os.ftruncate(self._file, 0)
            self._read_bytes = 0
