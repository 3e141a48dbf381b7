"""`indoor-mapping` and `python -m deploy`: an interrupt ends it at once and without a word from its first moment on."""

from __future__ import annotations

import os
import signal
import sys

from deploy import INTERRUPTED


def main() -> int:
    """The command line, which takes the interrupt over once its libraries are loaded."""
    signal.signal(signal.SIGINT, lambda *_: os._exit(INTERRUPTED))
    from deploy.cli import main as command_line

    return command_line()


if __name__ == "__main__":
    sys.exit(main())
