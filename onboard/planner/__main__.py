"""Process "planner": the Planner on the BeagleBone."""

import secrets
import sys

from common.process import run
from onboard.planner.planner import BOOT_BITS, Planner

if __name__ == "__main__":
    sys.exit(run("planner", lambda config, _arguments: Planner(config.has_camera, secrets.randbits(BOOT_BITS))))
