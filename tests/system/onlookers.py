"""People who look at the robot from elsewhere, each over a link of its own: `onlookers.py COUNT --config FILE`.

Says so on standard output once they see it, and looks on until it is killed.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from common.clock import FreeClock
from common.config_file import load_config
from common.messages.topics import ODOMETRY, STATUS
from common.zenoh_bus import ZenohBus

if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("count", type=int)
    parser.add_argument("--config", type=Path, required=True)
    parser.add_argument("--log-dir")
    arguments = parser.parse_args()
    config = load_config(arguments.config)
    buses = [ZenohBus(f"onlooker{i}", config, FreeClock(), mode="client") for i in range(arguments.count)]
    seen = False
    while True:
        looks = [bus.latest(topic) for bus in buses for topic in (ODOMETRY, *STATUS.values())]
        if not seen and any(looks):
            seen = True
            print("seen", flush=True)
        time.sleep(0.1)
