"""Several messages in one: what a module publishes in one step, ten times a second, travels together.

`Topic.bundle_key` says which topics do. In a bundle each message is what it would be alone, and is recorded as it came.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgpack

from common.codec import DecodeError
from common.messages.topics import TOPICS, Topic

_MESSAGES_MAX = 64  # in one bundle
_TOPICS_OF: dict[str, dict[str, Topic[Any]]] = {}
for _topic in TOPICS:
    if _topic.bundle_key:
        _TOPICS_OF.setdefault(_topic.bundle_key, {})[_topic.key] = _topic

Packed = tuple[str, bytes, bool]  # topic key, encoded message, whether it is news


def pack(messages: Sequence[Packed]) -> bytes:
    """The bundle of these messages, in order."""
    packed: bytes = msgpack.packb(messages)
    return packed


def unpack(bundle_key: str, data: bytes) -> list[Packed]:
    """The messages in a bundle; raises DecodeError where it is none, or holds what does not belong into it."""
    try:
        messages = msgpack.unpackb(data, use_list=False, max_array_len=_MESSAGES_MAX, max_map_len=0, max_ext_len=0)
    except (ValueError, msgpack.UnpackException) as error:
        raise DecodeError(f"not a bundle: {error}") from error
    if not isinstance(messages, tuple):
        raise DecodeError("not a bundle")
    topics = _TOPICS_OF[bundle_key]
    for message in messages:
        if not (isinstance(message, tuple) and [type(part) for part in message] == [str, bytes, bool]):
            raise DecodeError("not a bundle")
        if message[0] not in topics:
            raise DecodeError("a message that does not belong into this bundle")
    return list(messages)
