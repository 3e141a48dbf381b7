"""The back end as a process of the lowest priority: increments on stdin -> corrections on stdout.

It ends with its parent, whose end closes stdin.
"""

import os
import signal
import sys
from pathlib import Path

from onboard.mmu.back_end import BackEnd, Increment
from onboard.mmu.map_file import MapKeeper
from onboard.mmu.worker import receive, send


def main() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent decides
    os.nice(19)
    back_end, keeper = BackEnd(), MapKeeper(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
    while True:
        increment = receive(sys.stdin.buffer)
        if not isinstance(increment, Increment):
            return
        correction = back_end.take(increment)
        send(sys.stdout.buffer, correction)
        keeper.take(increment, correction)


if __name__ == "__main__":
    main()
