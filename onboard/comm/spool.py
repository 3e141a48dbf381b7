"""What the nodes of comm's own process have published and the disk does not have yet, where it outlives the process.

Producers in other processes keep their newest messages themselves, and comm asks for them after a restart; what shares
its process dies with it. So each such message is written at once into a file that lies in memory: that takes
microseconds and never waits for a disk. A power cut loses what a power cut may lose (`ROW_PERIOD_S`).
"""

from __future__ import annotations

import os
import struct
import threading
from contextlib import suppress
from pathlib import Path

import msgpack

from common.codec import DecodeError, read_header
from common.recording import RecordedMessage

_FOLDERS = (Path("/dev/shm"), Path("/run"))  # file systems in memory
_LEFT_BYTES_MAX = 16_000_000
_HEADER, _BYTES = struct.Struct(">BBB"), struct.Struct(">BI")


def spool_folder(log_dir: Path) -> Path | None:
    """A folder in memory for the comm whose log folder that is; None where the system has none."""
    name = f"indoor-mapping{str(log_dir.resolve()).replace('/', '-')}"
    parent = next((folder for folder in _FOLDERS if os.access(folder, os.W_OK)), None)
    return None if parent is None else parent / name[-200:]


class Spool:
    """Numbered files. `append` may be called by any thread, the rest by comm's.

    It is one safety net of several: an error of its file system only takes what is in it.
    """

    def __init__(self, folder: Path, *, begins: bool = False) -> None:
        """`begins`: there was no outbox before; what is left is of another, whose log folder was removed since."""
        self._folder = folder
        self._lock = threading.Lock()
        with suppress(OSError):
            folder.mkdir(mode=0o700, exist_ok=True)
        self._files = sorted(int(file.name) for file in folder.glob("*") if file.name.isdigit())
        self._number = self._files[-1] + 1 if self._files else 0
        self._open = -1
        if begins:
            self.forget(self._number + 1)

    def left(self) -> list[RecordedMessage]:
        """What an earlier process had not stored, in the order in which it came."""
        found: list[RecordedMessage] = []
        for number in self._files:
            with suppress(OSError), self._file(number).open("rb") as content:
                found += _messages(content.read(_LEFT_BYTES_MAX))
        return found

    def append(self, key: str, data: bytes) -> None:
        """Keeps an encoded message of a topic."""
        with self._lock, suppress(OSError):
            if self._open < 0:
                self._open = os.open(self._file(self._number), os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
                self._files.append(self._number)
            # A list of two, text and bytes, written out in MessagePack
            name = key.encode()
            os.write(self._open, _HEADER.pack(0x92, 0xD9, len(name)) + name + _BYTES.pack(0xC6, len(data)) + data)

    def turn(self) -> int:
        """Begins another file; returns a mark for `forget`."""
        with self._lock:
            if self._open >= 0:
                os.close(self._open)
            self._open = -1
            self._number += 1
            return self._number

    def forget(self, mark: int) -> None:
        """The disk has everything that was taken from the bus before the turn that returned `mark`.

        What was appended after that look at the bus, and before the turn, is in the file that ended then: it stays
        until the next mark.
        """
        with self._lock:
            stored = [number for number in self._files if number < mark - 1]
            self._files = self._files[len(stored) :]
        for number in stored:
            with suppress(OSError):
                self._file(number).unlink()

    def close(self) -> None:
        """The disk has everything."""
        self.turn()
        self.forget(self._number + 1)
        with suppress(OSError):
            self._folder.rmdir()

    def _file(self, number: int) -> Path:
        return self._folder / str(number)


def _messages(content: bytes) -> list[RecordedMessage]:
    """The last one may be cut."""
    unpacker = msgpack.Unpacker(use_list=False, max_buffer_size=_LEFT_BYTES_MAX)
    unpacker.feed(content)
    messages = []
    with suppress(ValueError, TypeError, msgpack.UnpackException, DecodeError):
        for key, data in unpacker:
            sequence, boot_id = read_header(data)
            messages.append(RecordedMessage(key, boot_id, sequence, data))
    return messages
