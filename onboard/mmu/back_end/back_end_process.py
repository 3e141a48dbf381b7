"""What the process of the back end loads (`common.side_process`), and no other: scipy is in that process only."""

from __future__ import annotations

from pathlib import Path

from common.side_work import Work
from onboard.mmu.back_end.exchange import Correction, Increment
from onboard.mmu.on_demand import on_demand

# Of scipy the back end calls a sparse factorisation and a tree; loading these two loads much of numpy and scipy
with on_demand("numpy.f2py", "numpy.testing", "scipy.spatial.distance", "scipy.spatial.transform"):
    from onboard.mmu.back_end.map_builder import MapBuilder


def load(map_file: str = "") -> Work[Increment, Correction]:
    """`map_file`: where the map is saved; empty saves nothing."""
    return MapBuilder(Path(map_file) if map_file else None).correction
