"""Signed commands: what a person orders counts once, soon, and only from who holds the command key. Pure.

comm publishes a challenge in its permit and renews it every CHALLENGE_PERIOD_S. The command center
signs the bytes of a command with HMAC-SHA256 over the topic's key, the challenge and the message, in which boot id and
sequence number stand. A receiver accepts a signature over the newest challenge or the one before it, if it received the
change to that challenge: a process that was just started does not know which commands were signed over the first one.
"""

from __future__ import annotations

import hmac

from common.fields import CHALLENGE_BYTES
from common.messages.stop import StopRequest

CHALLENGE_PERIOD_S = 2.0
SIGNATURE_BYTES = CHALLENGE_BYTES + 32  # challenge and HMAC-SHA256

_GENERATIONS = 2  # challenges that count at a time: a command is on its way while the next one comes


def needs_signature(payload: object) -> bool:
    """Every command but a stop, which must work in anybody's hand."""
    return not (isinstance(payload, StopRequest) and payload.latched)


def sign(command_key: bytes, key: str, data: bytes, challenge: bytes) -> bytes:
    """What travels beside the message `data` of the topic `key`."""
    return challenge + hmac.digest(command_key, key.encode() + b"\0" + challenge + data, "sha256")


class Signer:
    """The command center's side. `receive` may be called by another thread."""

    def __init__(self, command_key: bytes) -> None:
        self._command_key = command_key
        self._challenge: bytes | None = None

    @property
    def ready(self) -> bool:
        """The robot has sent a challenge, or the empty one: it wants no signature."""
        return self._challenge is not None

    def receive(self, challenge: bytes) -> None:
        self._challenge = challenge

    def sign(self, key: str, data: bytes) -> bytes:
        """Over the newest challenge; nothing where the robot wants none."""
        return sign(self._command_key, key, data, self._challenge) if self._challenge else b""


class Verifier:
    """The side of who obeys. `receive` may be called by another thread."""

    def __init__(self, command_key: bytes) -> None:
        self._command_key = command_key
        self._newest: bytes | None = None
        # Challenge -> topic's key and boot id -> sequence number of the newest command that was taken over it
        self._taken: dict[bytes, dict[tuple[str, int], int]] = {}

    def receive(self, challenge: bytes) -> None:
        """Of the newest permit."""
        if challenge == self._newest:
            return
        if self._newest is not None and challenge not in self._taken:
            before = list(self._taken.items())[1 - _GENERATIONS :]
            self._taken = dict(before) | {challenge: {}}
        self._newest = challenge

    def refusal(self, key: str, boot_id: int, sequence: int, data: bytes, signature: bytes) -> str:
        """Why the command must not be obeyed; empty when it may, and then it never may again."""
        if not signature:
            return "it is not signed"
        challenge = signature[:CHALLENGE_BYTES]
        if not hmac.compare_digest(signature, sign(self._command_key, key, data, challenge)):
            return "its signature is wrong"
        taken = self._taken.get(challenge)
        if taken is None:
            return "it was signed too long ago, or before this process received the challenge"
        if sequence <= taken.get((key, boot_id), 0):
            return "it was obeyed already, and is sent again"
        taken[key, boot_id] = sequence
        return ""
