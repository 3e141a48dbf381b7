"""What a process publishes on one topic: numbered, sent, and kept for queries.

STATE topics reply to a query with everything since the newest full snapshot. A query with a payload
(`recording.gap_query`) gets of that only what is newer; on recorded topics, of the newest messages, so that who records
them misses nothing while it is restarted. A query beyond the budget of the process is refused, and comes again.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Any, Generic, TypeVar

import msgpack
import zenoh

from common.bus import UNFIT
from common.codec import Envelope, encode
from common.field_checks import UnfitValue
from common.messages.topics import QosProfile, Topic
from common.recording import QUERY_BYTES_MAX, RecentMessages, queried_after
from common.repeats import Repeats
from common.reply_budget import ReplyBudget
from common.undecodable import Undecodable
from common.zenoh_end import CONGESTION, Arrival, ZenohEnd
from common.zenoh_session import direct

P = TypeVar("P")

_PRIORITY = {
    QosProfile.COMMAND: zenoh.Priority.REAL_TIME,
    QosProfile.LATEST: zenoh.Priority.DATA_HIGH,
    QosProfile.EVENT: zenoh.Priority.DATA,
    QosProfile.STATE: zenoh.Priority.DATA_LOW,
    QosProfile.BULK: zenoh.Priority.BACKGROUND,
}

_log = logging.getLogger(__name__)


class Replies:
    """What all publishers of a process share: how much they reply, and how often they refused."""

    def __init__(self) -> None:
        self._budget = ReplyBudget()
        self._repeats = Repeats()
        self._lock = threading.Lock()

    def refuses(self, key: str, messages: list[bytes]) -> bool:
        now_s = time.monotonic()
        with self._lock:
            if self._budget.allows(sum(map(len, messages)), now_s):
                return False
            count = self._repeats.count(key, now_s)
        if count:
            _log.warning("a query was refused: the replies are over their budget key=%s count=%d", key, count)
        return True


class Outbox(Generic[P]):
    """One publisher. `sequence` is the number of the newest message."""

    def __init__(self, end: ZenohEnd, topic: Topic[P], boot_id: int, replies: Replies) -> None:
        self.sequence = 0
        self._end, self._topic, self._unfit = end, topic, Undecodable(UNFIT)
        self._key, self._boot_id, self._replies = end.key(topic), boot_id, replies
        self._lock = threading.Lock()
        # Since the newest snapshot, with their numbers
        self._history: list[tuple[int, bytes]] | None = [] if topic.qos is QosProfile.STATE else None
        self._recent = RecentMessages() if topic.recorded else None
        session = end.session_for(topic)
        self._publisher: Any = None
        if not topic.bundle_key:
            self._publisher = session.declare_publisher(
                self._key, priority=_PRIORITY[topic.qos], congestion_control=CONGESTION
            )
        self._queryable: Any = None
        if self._history is not None or self._recent is not None:
            self._queryable = session.declare_queryable(self._key, direct(self._reply))

    def publish(
        self,
        payload: P,
        sign: Callable[[bytes], bytes | None],
        send: Callable[[Topic[P], bytes, bool], None],
        *,
        news: bool,
    ) -> None:
        """Any thread may; `sign` makes of the message what goes with it, `send` takes those that travel in a bundle."""
        with self._lock:
            try:
                data = encode(payload, self.sequence + 1, self._boot_id)
            except UnfitValue as error:
                self._unfit.count(self._topic.key, str(error))
                return
            self.sequence += 1
            signature = sign(data)
            # First of all it is sent; a query waits for the lock
            if self._publisher is None:
                send(self._topic, data, news)
            else:
                self._publisher.put(data, attachment=signature)
            envelope = Envelope(payload, self.sequence, self._boot_id)
            self._end.deliver(self._topic.key, Arrival(data, signature or b"", envelope, is_own=True, news=news))
            if self._recent is not None:
                self._recent.append(self.sequence, data)
            if self._history is not None:
                # An increment (`MapUpdate.start` > 0) is worth nothing without what it goes on from
                if not getattr(payload, "start", 0):
                    self._history.clear()
                self._history.append((self.sequence, data))

    def _reply(self, query: zenoh.Query) -> None:
        payload = query.payload
        if payload is not None and len(payload) > QUERY_BYTES_MAX:
            return
        after = queried_after(bytes(payload), self._boot_id) if payload is not None else 0
        with self._lock:
            if payload is not None and self._recent is not None:
                messages = self._recent.after(after)
            else:
                messages = [data for number, data in self._history or () if number > after]
        if self._replies.refuses(self._key, messages):
            query.reply_err(b"later")
        else:
            query.reply(self._key, msgpack.packb(messages))
