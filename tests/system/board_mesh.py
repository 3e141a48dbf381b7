"""The processes of a BeagleBone as its units start them, without systemd: `CONFIG FOLDER`. Until the robot may move.

Needs nothing but what a board has. Prints what is missing, and exits with 1, when no permit comes in time.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

from common.clock import FreeClock
from common.config_file import load_config
from common.messages.topics import PERMIT
from common.zenoh_bus import ZenohBus
from deploy.local.process_table import program_of
from onboard.comm.stop_record import RECORD_NAME, StopRecord, write_record

PERMIT_S = 240.0  # ten times slower than a laptop, and that one may be busy
END_S = 60.0


def main(config_file: Path, folder: Path) -> int:
    config = load_config(config_file)
    write_record(folder / RECORD_NAME, StopRecord())
    arguments = ["--config", str(config_file), "--log-dir", str(folder)]
    running = [
        subprocess.Popen([sys.executable, "-m", *program_of(process), *arguments])
        for process in config.beaglebone.processes
    ]
    bus = ZenohBus("watcher", config, FreeClock())
    reason = "no permit at all"
    end_s = time.monotonic() + PERMIT_S
    while time.monotonic() < end_s and all(process.poll() is None for process in running):
        permit = bus.latest(PERMIT)
        if permit is not None and permit.granted:
            reason = ""
            break
        reason = permit.reason if permit is not None else reason
        time.sleep(0.02)
    bus.close()
    for process in running:
        process.send_signal(signal.SIGTERM)
    codes = [process.wait(END_S) for process in running]
    print(f"permit: {reason or 'granted'}; exit codes {codes}")
    return 1 if reason or any(codes) else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
