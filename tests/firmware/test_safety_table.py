"""The safety state machine, every state with every set of conditions; and a line full of garbage, sanitizers on."""

from __future__ import annotations

import re
import shutil
import subprocess
from itertools import product
from pathlib import Path

import pytest

from offboard.simulator.electronics import board
from offboard.simulator.electronics.board import next_safety_state
from onboard.bridge.protocol import CarState

BITS = {
    name: int(value)
    for name, value in re.findall(r"k(\w+) = (\d+),", (board.SKETCH / "src" / "core" / "safety.h").read_text())
}
ALL = [
    (CarState(state), {name for name, bit in BITS.items() if mask & bit}, mask)
    for state, mask in product(CarState, range(1 << len(BITS)))
]
WORKING = {CarState.READY, CarState.MOVING, CarState.BACKING_OFF}
DRIVING = {CarState.MOVING, CarState.BACKING_OFF}
RANDOM_BYTES = 1_000_000
FUZZ_S = 60


def following(state: CarState, mask: int) -> CarState:
    return CarState(next_safety_state(state, mask))


def test_conditions_are_bits_of_their_own() -> None:
    assert sorted(BITS.values()) == [1 << n for n in range(len(BITS))]
    assert {"Calibrated", "Armed", "Heartbeat", "StopLatched", "Faulty", "Moving", "Contact"} == set(BITS)


@pytest.mark.requirement("CAR_MR_05")
def test_a_latched_stop_or_a_fault_never_leads_to_a_state_that_works() -> None:
    for state, holds, mask in ALL:
        if holds & {"StopLatched", "Faulty"}:
            assert following(state, mask) not in WORKING, (state, holds)
        if "Faulty" in holds:
            assert following(state, mask) is CarState.FAULT


def test_only_an_armed_board_works_and_only_with_heartbeats_it_drives() -> None:
    for state, holds, mask in ALL:
        then = following(state, mask)
        if "Armed" not in holds:
            assert then not in WORKING, (state, holds)
        if "Heartbeat" not in holds:
            assert then not in DRIVING, (state, holds)


def test_no_state_but_ready_ever_begins_to_drive() -> None:
    for state, holds, mask in ALL:
        if state not in WORKING:
            assert following(state, mask) not in DRIVING, (state, holds)


def test_backing_off_comes_before_driving() -> None:
    for state, holds, mask in ALL:
        if state in WORKING and {"Contact", "Armed", "Heartbeat"} <= holds and not holds & {"StopLatched", "Faulty"}:
            assert following(state, mask) is CarState.BACKING_OFF


def test_nothing_leaves_boot_before_the_gyro_is_calibrated() -> None:
    for state, holds, mask in ALL:
        if state is CarState.BOOT and not holds & {"Calibrated", "Faulty"}:
            assert following(state, mask) is CarState.BOOT


def test_every_state_can_be_reached_and_left() -> None:
    reached = {following(state, mask) for state, _, mask in ALL if following(state, mask) is not state}
    left = {state for state, _, mask in ALL if following(state, mask) is not state}
    assert reached | {CarState.BOOT} == set(CarState)
    assert left == set(CarState)


def fuzz_command(compiler: str, program: Path, *flags: str) -> list[str]:
    sources = [board.HOST / "fuzz.cpp", board.HOST / "host_board.cpp", *(board.SKETCH / "src" / "core").glob("*.cpp")]
    return [compiler, "-std=c++11", "-g", "-O1", "-fno-sanitize-recover=all", *flags, "-o", str(program)] + [
        str(source) for source in sources
    ]


def test_a_million_random_bytes_crash_nothing_and_start_no_motor(tmp_path: Path) -> None:
    if shutil.which("g++") is None:
        pytest.skip("needs apt install g++")
    program = tmp_path / "random_bytes"
    flags = ("-fsanitize=address,undefined", f"-DRANDOM_BYTES={RANDOM_BYTES}")
    subprocess.run(fuzz_command("g++", program, *flags), check=True)
    result = subprocess.run([program], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout) == (0, "held\n"), result.stderr


@pytest.mark.slow
@pytest.mark.timeout(FUZZ_S + 120)
def test_a_fuzzer_finds_nothing(tmp_path: Path) -> None:
    clang = shutil.which("clang++") or shutil.which("clang++-14")
    if clang is None:
        pytest.skip("needs apt install clang")
    program = tmp_path / "fuzz"
    subprocess.run(fuzz_command(clang, program, "-fsanitize=fuzzer,address,undefined"), check=True)
    lines = tmp_path / "corpus"
    lines.mkdir()
    (lines / "line").write_bytes(b"CM_CAR_1_HB,7*0000\nPLN_CAR_2_DRV,1,1,9000*FFFF\n")
    result = subprocess.run(
        [program, f"-max_total_time={FUZZ_S}", "-max_len=600", str(lines)],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert result.returncode == 0, result.stderr[-2000:]
