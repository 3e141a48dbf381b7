"""The process of the Communication Module: `python -m onboard.comm`."""

import sys

from common.process import run
from onboard.comm.comm import make_comm

sys.exit(run("comm", make_comm, mode="router"))
