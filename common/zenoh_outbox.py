"""What a process says on one topic: numbered, sent, and kept for who asks.

STATE topics answer a query with everything since the newest full snapshot. Recorded topics answer the same query with a
question in it (`recording.request_for`) from their newest messages, so that who records them misses nothing while it is
restarted. What is request for beyond the process's budget is refused; the asker asks again.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Any, Generic, TypeVar

import msgpack
import zenoh

from common.answer_budget import AnswerBudget
from common.bus import UNFIT
from common.codec import encode
from common.field_checks import UnfitValue
from common.messages import QosProfile, Topic
from common.recording import QUESTION_BYTES_MAX, RecentMessages, requested_after
from common.repeats import Repeats
from common.undecodable import Undecodable
from common.zenoh_session import direct

P = TypeVar("P")

_PRIORITY = {
    QosProfile.COMMAND: zenoh.Priority.REAL_TIME,
    QosProfile.LATEST: zenoh.Priority.DATA_HIGH,
    QosProfile.EVENT: zenoh.Priority.DATA,
    QosProfile.STATE: zenoh.Priority.DATA_LOW,
    QosProfile.BULK: zenoh.Priority.BACKGROUND,
}
# Nobody waits for a full link, or the robot would stand for it: what is recorded and was dropped is request for again
_CONGESTION = zenoh.CongestionControl.DROP

_log = logging.getLogger(__name__)


class Answers:
    """What all publishers of a process share: how much they answer, and how often they had to refuse."""

    def __init__(self) -> None:
        self._budget = AnswerBudget()
        self._repeats = Repeats()
        self._lock = threading.Lock()

    def refuses(self, key: str, messages: list[bytes]) -> bool:
        now_s = time.monotonic()
        with self._lock:
            if self._budget.allows(sum(map(len, messages)), now_s):
                return False
            count = self._repeats.count(key, now_s)
        if count:
            _log.warning("a question was refused: more is request than may be answered key=%s count=%d", key, count)
        return True


class Outbox(Generic[P]):
    """One publisher. `sequence` is the number of the newest message."""

    def __init__(self, session: zenoh.Session, key: str, topic: Topic[P], boot_id: int, answers: Answers) -> None:
        self.sequence = 0
        self._topic_key, self._unfit = topic.key, Undecodable(UNFIT)
        self._key, self._boot_id, self._answers = key, boot_id, answers
        self._lock = threading.Lock()
        self._history: list[bytes] | None = [] if topic.qos is QosProfile.STATE else None  # since the newest snapshot
        self._recent = RecentMessages() if topic.recorded else None
        self._publisher = session.declare_publisher(key, priority=_PRIORITY[topic.qos], congestion_control=_CONGESTION)
        self._queryable: Any = None
        if self._history is not None or self._recent is not None:
            self._queryable = session.declare_queryable(key, direct(self._answer))

    def publish(self, payload: P, sign: Callable[[bytes], bytes | None]) -> None:
        """Any thread may; `sign` makes of the message what goes with it."""
        with self._lock:
            try:
                data = encode(payload, self.sequence + 1, self._boot_id)
            except UnfitValue as error:
                self._unfit.count(self._topic_key, str(error))
                return
            self.sequence += 1
            # First of all it is sent; who asks for what was kept waits for the lock
            self._publisher.put(data, attachment=sign(data))
            if self._recent is not None:
                self._recent.append(self.sequence, data)
            if self._history is not None:
                # An increment (`MapUpdate.start` > 0) is worth nothing without what it goes on from
                if not getattr(payload, "start", 0):
                    self._history.clear()
                self._history.append(data)

    def _answer(self, query: zenoh.Query) -> None:
        request = query.payload
        if request is not None and len(request) > QUESTION_BYTES_MAX:
            return
        with self._lock:
            messages = list(self._history or ())
            if request is not None and self._recent is not None:
                messages = self._recent.after(requested_after(bytes(request), self._boot_id))
        if self._answers.refuses(self._key, messages):
            query.reply_err(b"later")
        else:
            query.reply(self._key, msgpack.packb(messages))
