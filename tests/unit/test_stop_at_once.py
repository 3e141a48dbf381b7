"""The stop that `estop` packs by hand is the one that everybody else sends."""

from __future__ import annotations

from common.codec import decode, encode
from common.messages.stop import StopRequest
from common.messages.topics import STOP
from offboard.operate import software_stop, stop_at_once
from offboard.operate.software_stop import StopControl


def test_the_packed_stop_is_that_of_the_codec() -> None:
    request = software_stop.request(software_stop.pressed(StopControl(), 3.5, 2**61 + 7), 3.5)
    assert stop_at_once.packed(3.5, 2**61 + 7, 4, 2**47 + 1) == encode(request, 4, 2**47 + 1)
    assert decode(stop_at_once.packed(3.5, 9, 4, 2), StopRequest).payload == StopRequest(
        3.5, "operator", True, stop_id=9
    )
    assert STOP.key == stop_at_once.KEY
    assert not STOP.bundle_key
