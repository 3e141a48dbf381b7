"""How well doors of hard looks are found: drives along the drawn walls of `offboard/evaluate/doors`."""

from __future__ import annotations

import time

from deploy.bench.order import Order
from offboard.evaluate.doors.drive import passed
from offboard.evaluate.doors.scoring import door_table
from offboard.evaluate.doors.walls import Look

WALLS, WALLS_QUICK = 24, 4  # of each look
SEED = 2  # nothing was tuned on its walls


def bench(order: Order) -> None:
    began_s = time.process_time()
    drives = [passed(look, i, SEED) for look in Look for i in range(WALLS_QUICK if order.quick else WALLS)]
    print(*door_table(drives), sep="\n", flush=True)
    print(f"{len(drives)} walls in {time.process_time() - began_s:.0f} s of processor time")
