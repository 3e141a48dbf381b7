"""The Mega's bootloader on a pseudo terminal: as much of Atmel's STK500v2 (AVR068) as avrdude needs of it."""

from __future__ import annotations

import os
import select
import threading
import tty
from contextlib import suppress

START, TOKEN, OK = 0x1B, 0x0E, 0x00
SIGN_ON, SET_PARAMETER, GET_PARAMETER, LOAD_ADDRESS = 0x01, 0x02, 0x03, 0x06
ENTER, LEAVE, PROGRAM_FLASH, READ_FLASH, READ_SIGNATURE = 0x10, 0x11, 0x13, 0x14, 0x1B
SIGNATURE = bytes((0x1E, 0x98, 0x01))  # of an ATmega2560
FLASH_BYTES = 256 * 1024


class Bootloader:
    """`path` is its serial port; `flash` what it holds. `silent`: nobody there, as with a wrong cable."""

    def __init__(self, *, silent: bool = False) -> None:
        self.flash = bytearray(b"\xff" * FLASH_BYTES)
        self.pages_written = 0
        self.sessions = 0
        self._silent = silent
        self._address = 0
        self._end, self._kept = os.openpty()
        tty.setraw(self._kept)
        self.path = os.ttyname(self._kept)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        os.close(self._end)
        os.close(self._kept)

    def _serve(self) -> None:
        buffer = b""
        while not self._stop.is_set():
            if select.select([self._end], [], [], 0.05)[0]:
                with suppress(OSError):  # nobody has the port open
                    buffer += os.read(self._end, 4096)
            while (message := self._cut(buffer)) is not None:
                sequence, body, buffer = message
                if not self._silent:
                    self._send(sequence, self._answer(body))

    @staticmethod
    def _cut(buffer: bytes) -> tuple[int, bytes, bytes] | None:
        """The first whole message: its number, its body, and what comes after it."""
        begin = buffer.find(START)
        if begin < 0 or len(buffer) < begin + 6:
            return None
        size = int.from_bytes(buffer[begin + 2 : begin + 4], "big")
        end = begin + 5 + size
        if len(buffer) <= end:
            return None
        return buffer[begin + 1], buffer[begin + 5 : end], buffer[end + 1 :]

    def _send(self, sequence: int, body: bytes) -> None:
        message = bytes((START, sequence)) + len(body).to_bytes(2, "big") + bytes((TOKEN,)) + body
        check = 0
        for byte in message:
            check ^= byte
        os.write(self._end, message + bytes((check,)))

    def _answer(self, body: bytes) -> bytes:
        command, done = body[0], bytes((body[0], OK))
        if command == SIGN_ON:
            self.sessions += 1
            return done + bytes((8,)) + b"AVRISP_2"
        if command == GET_PARAMETER:
            return done + b"\x02"
        if command == LOAD_ADDRESS:  # in words; the highest bit marks a far one
            self._address = 2 * (int.from_bytes(body[1:5], "big") & 0x7FFFFFFF)
        elif command == PROGRAM_FLASH:
            data = body[10 : 10 + int.from_bytes(body[1:3], "big")]
            self.flash[self._address : self._address + len(data)] = data
            self._address += len(data)
            self.pages_written += 1
        elif command == READ_FLASH:
            size = int.from_bytes(body[1:3], "big")
            data = bytes(self.flash[self._address : self._address + size])
            self._address += size
            return done + data + bytes((OK,))
        elif (
            command == READ_SIGNATURE
        ):  # behind the command: how, and the chip's own instruction with the byte's number
            return done + SIGNATURE[body[4] : body[4] + 1] + bytes((OK,))
        return done
