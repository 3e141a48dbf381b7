"""The two boards; the one with the AVR binary only where its tools are installed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from offboard.simulator.electronics import avr_board
from offboard.simulator.electronics.avr_board import AvrBoard
from offboard.simulator.electronics.board import Board, HostBoard


@pytest.fixture(scope="session")
def avr_tools() -> None:
    if avr_board.missing_tools():
        pytest.skip(f"needs {avr_board.INSTALL}")


@pytest.fixture
def avr(avr_tools: None) -> AvrBoard:
    return AvrBoard()


@pytest.fixture(params=["host", "avr"])
def make_board(request: pytest.FixtureRequest) -> Callable[[], Board]:
    if request.param == "host":
        return HostBoard
    request.getfixturevalue("avr_tools")
    return AvrBoard


@pytest.fixture(scope="session")
def bootloader(avr_tools: None) -> Path:
    """The one that every Mega is sold with."""
    if not avr_board.BOOTLOADER.exists():
        pytest.skip(f"needs {avr_board.INSTALL}")
    return avr_board.BOOTLOADER
