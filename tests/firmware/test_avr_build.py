"""The sketch as it is flashed: it compiles without a warning, fits, and opens in the Arduino IDE."""

from __future__ import annotations

import shutil
import subprocess

import pytest

from offboard.simulator.electronics import avr_board
from offboard.simulator.electronics.board import FirmwareBuildError

FLASH_MAX = 60_000
STATIC_RAM_MAX = 4_096


def test_firmware_fits_into_its_share_of_flash_and_memory(avr_tools: None) -> None:
    elf = avr_board.build_avr_firmware()
    text, data, bss = map(int, subprocess.check_output(["avr-size", elf], text=True).splitlines()[1].split()[:3])
    assert text + data <= FLASH_MAX
    assert data + bss <= STATIC_RAM_MAX


def test_firmware_has_neither_heap_nor_floating_point_text(avr_tools: None) -> None:
    symbols = subprocess.check_output(["avr-nm", avr_board.build_avr_firmware()], text=True)
    names = {line.split()[-1] for line in symbols.splitlines()}
    assert not names & {"malloc", "free", "vfprintf", "dtostrf"}


def test_sketch_compiles_as_the_arduino_ide_does_it(avr_tools: None) -> None:
    if shutil.which("arduino-builder") is None:
        pytest.skip("needs apt install arduino-builder")
    result = subprocess.run(
        ["make", "-s", "-C", avr_board.ARDUINO, "check"], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    assert "Sketch uses" in result.stdout
    ours = [line for line in result.stderr.splitlines() if "indoor_mapping" in line and "warning:" in line]
    assert ours == []


def test_sketch_folder_keeps_the_rules_of_the_ide() -> None:
    sketch = avr_board.SKETCH
    assert (sketch / f"{sketch.name}.ino").is_file()
    assert [path.name for path in sketch.iterdir() if path.name not in ("src", f"{sketch.name}.ino")] == []
    assert sorted(path.name for path in sketch.rglob("*.ino")) == [f"{sketch.name}.ino"]


def test_missing_tools_are_told_in_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(avr_board, "missing_tools", lambda: True)
    with pytest.raises(FirmwareBuildError, match=r"^[^.]*: apt install gcc-avr .*$"):
        avr_board.build_avr_firmware()
