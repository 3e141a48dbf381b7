"""The process of the bridge: `python -m onboard.bridge`."""

import sys

from common.process import run
from onboard.bridge.bridge import make_bridge

sys.exit(run("bridge", make_bridge))
