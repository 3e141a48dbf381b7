"""The Planner's process on the BeagleBone."""

import sys

from common.process import run
from onboard.planner.planner import make_planner

if __name__ == "__main__":
    sys.exit(run("planner", make_planner))
