"""Several modules of the robot in one process: `python -m onboard comm+mmu+planner`."""

from __future__ import annotations

import sys
from importlib import import_module

from common.process import Factory, run_together

# Module -> where its node is made; imported only where the module runs
FACTORIES = {
    "bridge": "onboard.bridge.bridge:make_bridge",
    "mmu": "onboard.mmu.mmu:make_mapping_unit",
    "planner": "onboard.planner.planner:make_planner",
    "poi": "onboard.poi.__main__:make_poi",
    "comm": "onboard.comm.comm:make_comm",
}


def factory_of(module: str) -> Factory:
    """What makes the module's node."""
    package, _, name = FACTORIES[module].partition(":")
    factory: Factory = getattr(import_module(package), name)
    return factory


def main(argv: list[str]) -> int:
    modules = argv[0].split("+") if argv else []
    if not modules or any(module not in FACTORIES for module in modules):
        sys.stderr.write(f"Name the modules first, joined by +, of: {', '.join(FACTORIES)}.\n")
        return 2
    return run_together(argv[0], {module: factory_of(module) for module in modules}, argv[1:])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
