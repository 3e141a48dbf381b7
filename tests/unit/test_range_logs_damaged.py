"""Damaged range logs: each is mapped or refused in one sentence, and none costs more than the frames that it holds."""

from __future__ import annotations

import random
import re
import resource
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from range_log_scenes import carmen_lines, csv_lines

from offboard.replay.range_log import RangeLogError, read_range_log
from offboard.replay.replay import replay

WORDS = (
    *(
        "nan",
        "inf",
        "-inf",
        "-1",
        "0",
        "",
        "x",
        "1e308",
        "-1e308",
        "1e-320",
        "1e9",
        "81.91",
        "655.35",
        "99999999999999",
    ),
    *("9" * 400, "1_000", "0x10", "١٢", "4294967295", "-2147483648", "\0", "#", "FLASER", "PARAM", '"', ";", "\x1b[2J"),
)
FRAMES = 30
SECONDS_MAX = 2.0  # of processor time, for one log
GROWTH_MAX_MB = 200
SWEEP = (13, -90.0, 15.0)


def _logs() -> tuple[bytes, ...]:
    lines = (
        csv_lines()[: 3 + FRAMES],
        carmen_lines(sweep=SWEEP)[: 2 + FRAMES],
        carmen_lines("ROBOTLASER1", sweep=SWEEP, silent="2.5")[: 2 + FRAMES],
    )
    return tuple(("\n".join(log) + "\n").encode() for log in lines)


def _bytes(data: bytes, rng: random.Random) -> bytes:
    out = bytearray(data)
    for _ in range(rng.choice((1, 3, 30))):
        out[rng.randrange(len(out))] = rng.randrange(256)
    return bytes(out)


def _span(data: bytes, rng: random.Random) -> bytes:
    a, b, to = sorted(rng.randrange(len(data)) for _ in range(2)) + [rng.randrange(len(data))]
    rest = data[:a] + data[b:]
    return rng.choice((rest, data[:a], data[b:], data[:to] + data[a:b] + data[to:], rest[:to] + data[a:b] + rest[to:]))


def _word(data: bytes, rng: random.Random) -> bytes:
    separator = rng.choice((b",", b" ", b"\n"))
    words = data.split(separator)
    for _ in range(rng.choice((1, 1, 3, 20))):
        at = rng.randrange(len(words))
        words[at] = rng.choice((*(w.encode() for w in WORDS), rng.choice(words)))
    return separator.join(words)


def _numbers(data: bytes, rng: random.Random) -> bytes:
    """Wild values that read well."""

    def wild(match: re.Match[bytes]) -> bytes:
        if rng.random() > share:
            return match.group()
        value = float(match.group())
        others = -value, value * 10.0 ** rng.randint(-6, 9), value + rng.gauss(0.0, 5.0), rng.choice((1e29, 1e308))
        return f"{rng.choice(others):.9g}".encode()

    share = rng.choice((0.002, 0.02, 0.2))
    return re.sub(rb"-?\d+\.\d+", wild, data)


def _lines(data: bytes, rng: random.Random) -> bytes:
    lines = data.splitlines(keepends=True)
    a, b = sorted(rng.randrange(len(lines) + 1) for _ in range(2))
    part = lines[a:b]
    rng.shuffle(part)
    return b"".join(rng.choice((lines[:a] + part + lines[b:], lines + part, lines[:a] + lines[b:], lines[::-1])))


DAMAGES: tuple[Callable[[bytes, random.Random], bytes], ...] = (_bytes, _span, _word, _numbers, _numbers, _lines)


def damaged(rng: random.Random, logs: tuple[bytes, ...]) -> bytes:
    data = rng.choice(logs)
    for _ in range(rng.choice((1, 1, 2))):
        data = rng.choice(DAMAGES)(data, rng) if len(data) > 1 else data
    return data


def mapped(log: Path) -> bool:
    """Whether it was; a refusal is one sentence."""
    try:
        run = replay(read_range_log(log))
    except RangeLogError as error:
        said = str(error)
        assert log.name in said
        assert said.endswith(".")
        assert "\n" not in said
        assert len(said) < 600
        return False
    for values in (run.times_s, run.online, run.smoothed, run.points):
        assert np.isfinite(values).all()
    assert (np.diff(run.times_s) > 0).all()
    return True


@pytest.mark.parametrize(
    "count", [250, pytest.param(30_000, marks=[pytest.mark.slow, pytest.mark.timeout(3600)])], ids=str
)
def test_a_damaged_log_is_mapped_or_refused(tmp_path: Path, count: int) -> None:
    logs, file = _logs(), tmp_path / "some.log"
    results = []
    for seed in range(-1, count):
        data = damaged(random.Random(seed), logs) if seed >= 0 else logs[0]
        file.write_bytes(data)
        began_s = time.process_time()
        before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                results.append(mapped(file))
            except Exception as error:
                error.add_note(f"seed {seed}")
                raise
        assert time.process_time() - began_s < SECONDS_MAX, f"seed {seed}"
        grown_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb
        assert grown_kb < 1024 * GROWTH_MAX_MB, f"seed {seed}"
    assert 0.1 < sum(results) / len(results) < 0.9
