"""Memory and processor of a module over the last ten minutes as one line of words and small bars. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from offboard.operate.health_history import SAMPLE_S, Sample

_BARS = "▁▂▃▄▅▆▇█"
_BARS_MAX = 20
_KB_PER_MB = 1024
_MB_FROM_KB = 10 * _KB_PER_MB


def health_text(samples: Sequence[Sample]) -> str:
    """From the least to the most of each, and how it went; empty where there is nothing yet."""
    if not samples:
        return ""
    memory = [float(sample.memory_kb) for sample in samples]
    unit = "kB"
    if max(memory) >= _MB_FROM_KB:
        memory, unit = [kb / _KB_PER_MB for kb in memory], "MB"
    cpu = [100 * sample.cpu_share for sample in samples]
    minutes = len(samples) * SAMPLE_S / 60
    parts = [f"memory {_span(memory)} {unit} {bars(memory)}"]
    if any(cpu):
        parts.append(f"cpu {_span(cpu)} % {bars(cpu)}")
    return f"{' · '.join(parts)} · last {minutes:.0f} min" if minutes >= 1 else " · ".join(parts)


def bars(values: Sequence[float]) -> str:
    """The newest as the last bar; from zero to the largest."""
    size = -(-len(values) // _BARS_MAX)
    groups = [max(values[max(0, end - size) : end]) for end in range(len(values), 0, -size)][::-1]
    top = max(groups)
    return "".join(_BARS[round((len(_BARS) - 1) * value / top)] if top > 0 else _BARS[0] for value in groups)


def _span(values: Sequence[float]) -> str:
    low, high = (f"{value:.0f}" for value in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"
