"""What is generated is up to date, and the firmware's copies are true."""

from __future__ import annotations

import importlib.util
import re
import tomllib
from pathlib import Path

import pytest

from common.errors import ErrorCode
from offboard.simulator.electronics import board

ROOT = Path(__file__).resolve().parents[2]


def _generator():
    spec = importlib.util.spec_from_file_location("generate_protocol", ROOT / "arduino" / "generate_protocol.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_generated_protocol_is_up_to_date() -> None:
    generator = _generator()
    definition = tomllib.loads(generator.DEFINITION.read_text(encoding="utf-8"))
    again = "run python arduino/generate_protocol.py"
    assert generator.HEADER.read_text(encoding="utf-8") == generator.c_header(definition), again
    assert generator.MODULE.read_text(encoding="utf-8") == generator.python_module(definition), again


def test_firmware_has_the_error_codes_of_the_table() -> None:
    text = (board.SKETCH / "src" / "core" / "errors.h").read_text(encoding="utf-8")
    copies = re.findall(r"= (\d+);\s+// = (\w+)", text)
    assert len(copies) >= 10
    for number, name in copies:
        assert int(number) == ErrorCode[name], name


def test_core_needs_neither_arduino_nor_heap() -> None:
    for path in sorted((board.SKETCH / "src" / "core").glob("*")):
        text = re.sub(r"//.*", "", path.read_text(encoding="utf-8"))
        assert not re.search(r"Arduino\.h|\bnew\b|malloc|\bdouble\b|<(?!(?:stdint|math)\.h>)\w+(\.h)?>\s*$", text), path


def test_missing_compiler_is_told_in_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(board, "LIBRARY", tmp_path / "none.so")
    monkeypatch.setattr(board.shutil, "which", lambda _: None)
    with pytest.raises(board.FirmwareBuildError, match=r"^g\+\+ is needed .* install it \(apt install g\+\+\)$"):
        board.build_firmware()
