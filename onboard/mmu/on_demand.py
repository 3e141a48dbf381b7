"""Lazy import of modules that a library loads and this program never uses: the real module is loaded on first use.

What scipy and numpy load in addition costs tens of megabytes of resident memory, and seconds at every start on a
BeagleBone.
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


class _Name:
    """A function of such a module, or something of one, by the path of its names; loaded when it is called."""

    def __init__(self, *path: str) -> None:
        self._path = path

    def __getattr__(self, name: str) -> _Name:
        if name.startswith("__"):
            raise AttributeError(name)
        return _Name(*self._path, name)

    def __call__(self, *args: Any, **options: Any) -> Any:
        module, *names = self._path
        if isinstance(sys.modules.get(module), _StandIn):
            return None  # the library, still being loaded, only tries which arguments an old version takes
        real: Any = reduce(getattr, names, import_module(module))
        return real(*args, **options)


class _StandIn(ModuleType):
    def __getattr__(self, name: str) -> _Name:
        if name.startswith("__"):
            raise AttributeError(name)
        return _Name(self.__name__, name)


class _StandIns(MetaPathFinder, Loader):
    """Finds these modules and what is in them."""

    def __init__(self, modules: Sequence[str]) -> None:
        self._modules = modules

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        ours = any(fullname == module or fullname.startswith(f"{module}.") for module in self._modules)
        return ModuleSpec(fullname, self, is_package=True) if ours else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return _StandIn(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        """There is nothing in it."""


@contextmanager
def on_demand(*modules: str) -> Iterator[None]:
    """What is imported inside gets stand-ins for those of the modules that are not loaded yet."""
    finder = _StandIns([module for module in modules if module not in sys.modules])
    sys.meta_path.insert(0, finder)
    try:
        yield
    finally:
        sys.meta_path.remove(finder)
        for name in [name for name, module in sys.modules.items() if isinstance(module, _StandIn)]:
            stand_in = sys.modules.pop(name)
            parent, _, own = name.rpartition(".")
            if parent in sys.modules and vars(sys.modules[parent]).get(own) is stand_in:
                delattr(sys.modules[parent], own)
