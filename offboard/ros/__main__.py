"""The process of the graph of ROS 2: `python -m offboard.ros`. It needs the extra `ros`."""

from __future__ import annotations

import argparse
import sys
import time
from functools import partial

from common.clock import FreeClock
from common.config import Config
from common.errors import StartError
from common.process import run
from common.zenoh_bus import ZenohBus
from offboard.operate.bus_operator import BusOperator
from offboard.ros import INSTALL
from offboard.ros.ros import Ros


def make_ros(config: Config, _: argparse.Namespace) -> Ros:
    """Raises StartError where rclpy is missing."""
    try:
        from offboard.ros.graph import RclpyGraph  # here, because rclpy is optional
    except ImportError as error:
        raise StartError(f"The process ros needs {error.name}. {INSTALL}") from error
    graph = RclpyGraph(network=config.ros.network)
    if config.ros.network:
        return Ros(graph, time.time)
    join = partial(ZenohBus, "command_center", config, FreeClock(), "client")
    return Ros(graph, time.time, partial(BusOperator, join))


if __name__ == "__main__":
    sys.exit(run("ros", make_ros))
