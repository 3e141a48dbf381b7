"""filterpy's extended Kalman filter, without the scipy that its other filters need -> `odometry`.

`import filterpy.kalman` loads scipy.stats, .ndimage, .sparse and .linalg for functions that the extended filter never
calls: 50 MB of resident memory, and seconds at every start on a BeagleBone. So, where a process does not use scipy
anyway, filterpy gets stand-ins for its modules, which load the real ones when something of them is called.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import reduce
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

import numpy as np


class _Name:
    """A function of scipy, or something of one, by the path of its names; loaded when it is called."""

    def __init__(self, *path: str) -> None:
        self._path = path

    def __getattr__(self, name: str) -> _Name:
        if name.startswith("__"):
            raise AttributeError(name)
        return _Name(*self._path, name)

    def __call__(self, *args: Any, **options: Any) -> Any:
        module, *names = self._path
        if isinstance(sys.modules.get(module), _StandIn):
            return None  # filterpy, still being loaded, only tries which arguments an old scipy takes
        real: Any = reduce(getattr, names, import_module(module))
        return real(*args, **options)


class _StandIn(ModuleType):
    """A module of scipy while filterpy is loaded."""

    def __getattr__(self, name: str) -> _Name:
        if name.startswith("__"):
            raise AttributeError(name)
        return _Name(self.__name__, name)


class _StandIns(MetaPathFinder, Loader):
    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        return ModuleSpec(fullname, self, is_package=True) if fullname.partition(".")[0] == "scipy" else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return _StandIn(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        """There is nothing in it."""


@contextmanager
def _scipy_on_demand() -> Iterator[None]:
    if "scipy" in sys.modules:
        yield
        return
    finder = _StandIns()
    sys.meta_path.insert(0, finder)
    try:
        yield
    finally:
        sys.meta_path.remove(finder)
        for name in [name for name, module in sys.modules.items() if isinstance(module, _StandIn)]:
            del sys.modules[name]


with _scipy_on_demand():
    from filterpy.kalman import EKF, ExtendedKalmanFilter

# The inverse of one number is all that the filter asks of it
EKF.linalg = np.linalg

__all__ = ["ExtendedKalmanFilter"]
