"""Flashing the Mega with Debian's avrdude, at a bootloader that stands in for its own."""

from __future__ import annotations

import random
import shutil
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path

import pytest

from common.errors import StartError
from deploy.boards.flash import Ran, flash, flash_here
from deploy.cli import main
from onboard.bridge.serial_port import SerialPort
from tests.unit.stk500v2 import Bootloader

pytestmark = pytest.mark.skipif(shutil.which("avrdude") is None, reason="needs: apt install avrdude")
PAGE_BYTES = 256


@pytest.fixture
def mega() -> Iterator[Bootloader]:
    with closing(Bootloader()) as made:
        yield made


def content(seed: int, size: int = 3_000) -> bytes:
    return random.Random(seed).randbytes(size)


def hex_file(folder: Path, data: bytes) -> Path:
    """Intel HEX: records of 16 bytes with address and checksum."""
    records = [(at, 0, data[at : at + 16]) for at in range(0, len(data), 16)] + [(0, 1, b"")]
    lines = []
    for at, kind, part in records:
        record = bytes((len(part),)) + at.to_bytes(2, "big") + bytes((kind,)) + part
        lines.append(f":{(record + bytes((-sum(record) & 255,))).hex().upper()}\n")
    file = folder / "firmware.hex"
    file.write_text("".join(lines), encoding="ascii")
    return file


def test_what_is_flashed_is_what_the_file_has_and_a_second_time_nothing_is_written(
    mega: Bootloader, tmp_path: Path
) -> None:
    firmware, lines = hex_file(tmp_path, content(1)), list[str]()
    assert flash_here(mega.path, firmware, lines.append)
    assert bytes(mega.flash[:3_000]) == content(1)
    assert lines == ["writing the firmware; leave the cable alone ..."]
    written = mega.pages_written
    assert not flash_here(mega.path, firmware, lines.append)
    assert (mega.pages_written, len(lines)) == (written, 1)


def test_one_byte_that_differs_is_flashed_anew(mega: Bootloader, tmp_path: Path) -> None:
    assert flash_here(mega.path, hex_file(tmp_path, content(1)), print)
    mega.flash[2_999] ^= 1
    assert flash_here(mega.path, hex_file(tmp_path, content(1)), print)
    assert bytes(mega.flash[:3_000]) == content(1)


def test_a_port_that_another_program_has_is_left_alone(mega: Bootloader, tmp_path: Path) -> None:
    with closing(SerialPort(mega.path, 115200)), pytest.raises(StartError, match="in use by another program"):
        flash_here(mega.path, hex_file(tmp_path, content(1)), print)
    assert mega.sessions == 0


def test_what_goes_wrong_is_said_in_one_sentence(tmp_path: Path) -> None:
    def avrdude(words: Sequence[str]) -> Ran:
        if words[0] == "test":
            return Ran(0, "")
        return Ran(1, "avrdude OS error: ioctl\navrdude error: timeout\navrdude error: timeout\n\navrdude done.\n")

    with pytest.raises(StartError, match=r"^The Mega at /dev/ttyACM0 was not flashed \(timeout\): check its cable"):
        flash(avrdude, "/dev/ttyACM0", "firmware.hex", print)
    with pytest.raises(StartError, match="apt install avrdude"):
        flash(lambda words: Ran(0 if words[0] == "test" else 127, ""), "/dev/ttyACM0", "firmware.hex", print)
    with pytest.raises(StartError, match="nowhere is not there"):
        flash_here("/dev/nowhere", hex_file(tmp_path, content(1)), print)


def test_the_verb_flashes_what_hangs_on_this_machine(
    mega: Bootloader, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    firmware = str(hex_file(tmp_path, content(2)))
    words = ["deploy", "flash", "--port", mega.path, "--firmware", firmware]
    assert main([*words, "--dry-run"]) == 0
    assert mega.sessions == 0
    assert main(words) == 0
    assert main(words) == 0
    shown = capsys.readouterr().out
    assert shown.count("is flashed") == shown.count("has this firmware already") == 1
    assert bytes(mega.flash[:3_000]) == content(2)
