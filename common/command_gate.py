"""Commands on a process's bus, where the mesh has keys: signs those that it publishes, verifies those that it receives.

Without keys everything passes. What is refused is counted and logged, the same once a second.
"""

from __future__ import annotations

import logging
import time
from pathlib import Path
from typing import Any

from common import access
from common.codec import Envelope
from common.config import Config
from common.keys import COMMAND_ROLES, read_command_key
from common.messages.topics import TOPICS, Topic
from common.repeats import Repeats
from common.signing import Signer, Verifier, needs_signature

_log = logging.getLogger(__name__)


class CommandGate:
    """Of the process `name`; raises StartError when it needs the command key and cannot read it."""

    def __init__(self, name: str, config: Config) -> None:
        self._robot = config.robot.name
        self._signer: Signer | None = None
        self._verifier: Verifier | None = None
        self._repeats = Repeats()
        role = access.role_of(name)
        if not config.mesh.keys or role not in COMMAND_ROLES:
            return
        if any(topic.is_command and topic.producer == name for topic in TOPICS):
            self._signer = Signer(read_command_key(Path(config.mesh.keys), role))
        elif any(topic.is_command and name in topic.consumers for topic in TOPICS):
            self._verifier = Verifier(read_command_key(Path(config.mesh.keys), role))

    @property
    def wants_challenges(self) -> bool:
        return self._signer is not None or self._verifier is not None

    def receive(self, challenge: bytes) -> None:
        """The newest permit's challenge; called by Zenoh's thread."""
        for side in (self._signer, self._verifier):
            if side is not None:
                side.receive(challenge)

    def holds_back(self, topic: Topic[Any], payload: object) -> bool:
        """It cannot be signed yet; commands are repeated until they are acknowledged."""
        return self._signer is not None and topic.is_command and needs_signature(payload) and not self._signer.ready

    def sign(self, topic: Topic[Any], payload: object, data: bytes) -> bytes | None:
        """What goes with a message; None where nothing does."""
        if self._signer is None or not topic.is_command or not needs_signature(payload):
            return None
        return self._signer.sign(self._key(topic), data)

    def refuses(self, topic: Topic[Any], envelope: Envelope[Any], data: bytes, signature: bytes) -> bool:
        if self._verifier is None or not topic.is_command or not needs_signature(envelope.payload):
            return False
        key = self._key(topic)
        refusal = self._verifier.refusal(key, envelope.boot_id, envelope.sequence, data, signature)
        if not refusal:
            return False
        complaint = f"a command was refused: {refusal} topic={topic.key}"
        count = self._repeats.count(complaint, time.monotonic())
        if count:
            _log.warning("%s count=%d", complaint, count)
        return True

    def _key(self, topic: Topic[Any]) -> str:
        return f"{self._robot}/{topic.key}"
