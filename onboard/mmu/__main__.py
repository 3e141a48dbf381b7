"""Process "mmu": the mapping unit on the BeagleBone."""

import sys

from common.process import run
from onboard.mmu.mmu import make_mapping_unit

if __name__ == "__main__":
    sys.exit(run("mmu", make_mapping_unit))
