"""The first messages of `estop`, on their way before anything else is loaded.

What packs, sends and receives messages in general loads half of the project, and NumPy. One message that is known
beforehand needs none of it: here it is packed by hand, as `common/codec.py` does. It is sent every REPEAT_S, until the
bus that waits for its confirmation is there and goes on with the same press.
"""

from __future__ import annotations

import secrets
import threading
import time
from types import TracebackType

import msgpack

from common.config import Config
from common.zenoh_channel import WIFI_LEASE_S, commander_channel, open_session, put_command
from offboard.operate.stop_press import REPEAT_S, SOURCE, new_stop_id

KEY = "command_center/stop"
_VERSION = 1  # of the codec
_BOOT_BITS = 48


def packed(t_s: float, stop_id: int, sequence: int, boot_id: int) -> bytes:
    """A `StopRequest` that latches, as the codec packs it."""
    fields = {"t_s": t_s, "source": SOURCE, "latched": True, "valid": True, "stop_id": stop_id, "epoch": 0}
    data: bytes = msgpack.packb([_VERSION, sequence, boot_id, fields])
    return data


class StopAtOnce:
    """Sends from its beginning to its end, in a thread. `stop_id` and `since_s`: of the press.

    Raises StartError when the mesh cannot be joined.
    """

    def __init__(self, config: Config) -> None:
        self.since_s, self.stop_id = time.monotonic(), new_stop_id(secrets.randbits)
        self._boot_id, self._sequence = secrets.randbits(_BOOT_BITS), 0
        self._key = f"{config.robot.name}/{KEY}"
        self._session = open_session(commander_channel(config), WIFI_LEASE_S)
        self._ended = threading.Event()
        # Whatever becomes of it, the bus that follows sends the same press
        threading.Thread(target=self._run, name="stop", daemon=True).start()

    def __enter__(self) -> StopAtOnce:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()

    def _run(self) -> None:
        self._send()
        while not self._ended.wait(REPEAT_S):
            self._send()

    def _send(self) -> None:
        self._sequence += 1
        data = packed(time.monotonic(), self.stop_id, self._sequence, self._boot_id)
        put_command(self._session, self._key, data)
