"""On which machine figures were measured, and how busy it was."""

from __future__ import annotations

import os
import platform
from pathlib import Path

import numpy as np
import numpy.typing as npt


def machine() -> str:
    """One line: processor, cores, load of the last minute, kernel, Python."""
    load = os.getloadavg()[0]
    return (
        f"{_processor()}, {os.cpu_count()} cores, load {load:.1f}, "
        f"{platform.system()} {platform.release()}, Python {platform.python_version()}"
    )


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.split(":", 1)[1].strip() for line in lines if line.lower().startswith("model name")]
    return names[0] if names else platform.machine()


def percentiles(values_s: npt.ArrayLike, unit: str = "ms") -> str:
    """p50, p99 and the largest of some durations in seconds, in "ms" or "us"."""
    scale = {"ms": 1e3, "us": 1e6}[unit]
    p50, p99, largest = scale * np.percentile(np.asarray(values_s), [50, 99, 100])
    return f"p50 {p50:.1f}, p99 {p99:.1f}, max {largest:.1f} {unit}"
