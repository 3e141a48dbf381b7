"""What the firmware costs on the Mega, measured in simavr while the robot drives: `indoor-mapping bench firmware`.

Processor, interrupt latency, memory and the serial line.
"""

from __future__ import annotations

import subprocess
import sys

from common.constants import SERIAL_BAUD
from common.messages.motion import Speed
from deploy.bench.order import Order
from deploy.boards.board_link import BoardLink
from offboard.simulator.building.floor import load_floor
from offboard.simulator.electronics.avr_board import AvrBoard, build_avr_firmware
from offboard.simulator.electronics.serial_line import BITS_PER_BYTE, HostPort, SerialLine
from offboard.simulator.error_profiles import PROFILES, random_stream
from offboard.simulator.physics.world import STEP_S, World
from offboard.simulator.run.options import FLOORS

SECONDS = 20.0


class CountingBoard(AvrBoard):
    """Counts what it sends."""

    sent_bytes = 0

    def serial_read(self) -> bytes:
        data = super().serial_read()
        self.sent_bytes += len(data)
        return data


def bench(_: Order) -> None:
    """Prints the figures; a short run is enough."""
    board = CountingBoard()
    profile = PROFILES["realistic"]
    line = SerialLine(profile, random_stream(0, "serial"), STEP_S)
    world = World(load_floor(FLOORS / "straight.json"), 0, 0, profile, board, line)
    link = BoardLink(HostPort(line))
    link.allow_motion()
    while not link.ready:
        world.step()
        link.step(world.time_s)
    heading_deg = link.odo.yaw_cdeg / 100.0 if link.odo is not None else 0.0
    link.drive(Speed.MEDIUM, heading_deg)
    begin_s, sent_bytes = world.time_s, board.sent_bytes
    while world.time_s < begin_s + SECONDS:
        world.step()
        link.step(world.time_s)
    bytes_per_s = (board.sent_bytes - sent_bytes) / SECONDS
    size = subprocess.check_output(["avr-size", build_avr_firmware()], text=True).splitlines()[1].split()
    sys.stdout.write(
        f"flash {int(size[0]) + int(size[1])} bytes, variables {int(size[1]) + int(size[2])} bytes\n"
        f"processor: control loop {100 * (board.busy_share - board.interrupt_share):.0f} %, interrupts "
        f"{100 * board.interrupt_share:.0f} %, worst interrupt latency {board.worst_interrupt_latency_us:.0f} us\n"
        f"memory never touched {board.untouched_ram} bytes of 8192\n"
        f"line {bytes_per_s:.0f} bytes/s, {100 * bytes_per_s * BITS_PER_BYTE / SERIAL_BAUD:.0f} % of "
        f"{SERIAL_BAUD} baud\n"
    )
