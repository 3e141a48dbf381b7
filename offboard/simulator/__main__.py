"""The process that stands in for the world: `python -m offboard.simulator --floor FILE --config robot.toml`."""

import sys

from common.process import run
from offboard.simulator.run.process import make_simulator, simulator_parser

sys.exit(run("simulator", make_simulator, parser=simulator_parser(), leads_clock=True))
