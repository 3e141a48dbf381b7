"""Process "mmu": the mapping unit on the BeagleBone."""

import sys

from common.process import run
from onboard.mmu.mmu import MappingUnit

if __name__ == "__main__":
    sys.exit(run("mmu", lambda config, _: MappingUnit(config.sonars.bearings_rad)))
