"""The back end as a process of the lowest priority: increments on stdin -> corrections on stdout.

It ends with its parent, whose end closes stdin.
"""

import os
import signal
import sys
from pathlib import Path

from common.memory import give_back
from onboard.mmu.back_end.exchange import Increment
from onboard.mmu.back_end.worker import receive, send
from onboard.mmu.on_demand import on_demand

# Of scipy the back end calls a sparse factorisation and a tree; loading these two loads much of numpy and scipy
with on_demand("numpy.f2py", "numpy.testing", "scipy.spatial.distance", "scipy.spatial.transform"):
    from onboard.mmu.back_end.map_builder import MapBuilder


def main() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent decides
    os.nice(19)
    builder = MapBuilder(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
    while True:
        increment = receive(sys.stdin.buffer)
        if not isinstance(increment, Increment):
            return
        send(sys.stdout.buffer, builder.take(increment))
        builder.save()
        give_back()


if __name__ == "__main__":
    main()
