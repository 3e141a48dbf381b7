"""Signed commands: what counts, once, and what never does."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.messages.mission import Operation, OperatorCommand
from common.messages.stop import StopRequest
from common.signing import CHALLENGE_BYTES, SIGNATURE_BYTES, Signer, Verifier, needs_signature

KEY = b"k" * 32
TOPIC = "robot1/command_center/operation"
BOOT = 7
challenges = st.binary(min_size=CHALLENGE_BYTES, max_size=CHALLENGE_BYTES)


def challenge(number: int) -> bytes:
    return number.to_bytes(CHALLENGE_BYTES)


class Pair:
    """A command center and a robot that hear the same challenges; two have appeared."""

    def __init__(self) -> None:
        self.signer, self.verifier = Signer(KEY), Verifier(KEY)
        self._renewed = 0
        self.renew()
        self.renew()

    def renew(self) -> None:
        self._renewed += 1
        for side in (self.signer, self.verifier):
            side.receive(challenge(self._renewed))

    def refusal(self, sequence: int, data: bytes, signature: bytes, boot: int = BOOT, topic: str = TOPIC) -> str:
        return self.verifier.refusal(topic, boot, sequence, data, signature)


@given(data=st.binary(), sequence=st.integers(1, 2**53))
def test_a_signed_command_counts_once(data: bytes, sequence: int) -> None:
    pair = Pair()
    signature = pair.signer.sign(TOPIC, data)
    assert len(signature) == SIGNATURE_BYTES
    assert pair.refusal(sequence, data, signature) == ""
    assert "sent again" in pair.refusal(sequence, data, signature)


@given(data=st.binary(), position=st.integers(0), bit=st.integers(0, 7), in_signature=st.booleans())
def test_a_changed_bit_is_refused(data: bytes, position: int, bit: int, in_signature: bool) -> None:
    pair = Pair()
    signature = pair.signer.sign(TOPIC, data)
    changed = bytearray(signature if in_signature else data or b"\0")
    changed[position % len(changed)] ^= 1 << bit
    assert pair.refusal(1, data if in_signature else bytes(changed), bytes(changed) if in_signature else signature)
    assert pair.refusal(1, data, signature) == ""


@given(junk=st.binary(max_size=100))
def test_what_is_no_seal_is_refused(junk: bytes) -> None:
    pair = Pair()
    assert pair.refusal(1, b"release", junk)
    assert pair.refusal(1, b"release", pair.signer.sign(TOPIC, b"release") + b"\0")


def test_another_key_and_another_topic_are_refused() -> None:
    pair = Pair()
    foreign = Signer(b"x" * 32)
    foreign.receive(challenge(2))
    assert "signature is wrong" in pair.refusal(1, b"go", foreign.sign(TOPIC, b"go"))
    assert pair.refusal(1, b"go", pair.signer.sign(TOPIC, b"go"), topic="robot2/command_center/operation")
    assert "not signed" in pair.refusal(1, b"go", b"")


def test_a_seal_outlives_one_renewal_and_not_two() -> None:
    pair = Pair()
    first, second = pair.signer.sign(TOPIC, b"1"), pair.signer.sign(TOPIC, b"2")
    pair.renew()
    assert pair.refusal(1, b"1", first) == ""
    pair.renew()
    assert "too long ago" in pair.refusal(2, b"2", second)


@given(renewals=st.integers(0, 6), later=st.integers(0, 6))
def test_a_command_that_was_obeyed_never_is_again(renewals: int, later: int) -> None:
    pair = Pair()
    for _ in range(renewals):
        pair.renew()
    signature = pair.signer.sign(TOPIC, b"go")
    assert pair.refusal(9, b"go", signature) == ""
    for _ in range(later):
        pair.renew()
    assert pair.refusal(9, b"go", signature)


def test_a_robot_that_was_just_started_takes_nothing_over_the_challenge_that_it_finds() -> None:
    pair = Pair()
    signature = pair.signer.sign(TOPIC, b"go")
    assert pair.refusal(1, b"go", signature) == ""
    started = Verifier(KEY)
    started.receive(challenge(2))
    started.receive(challenge(2))
    assert started.refusal(TOPIC, BOOT, 1, b"go", signature)
    started.receive(challenge(3))
    assert started.refusal(TOPIC, BOOT, 1, b"go", signature)
    pair.renew()
    assert started.refusal(TOPIC, BOOT, 2, b"go", pair.signer.sign(TOPIC, b"go")) == ""


def test_senders_do_not_hold_each_other_up() -> None:
    pair = Pair()
    assert pair.refusal(100, b"a", pair.signer.sign(TOPIC, b"a"), boot=1) == ""
    assert pair.refusal(1, b"b", pair.signer.sign(TOPIC, b"b"), boot=2) == ""
    assert pair.refusal(99, b"c", pair.signer.sign(TOPIC, b"c"), boot=1)


@given(heard=st.lists(challenges, max_size=30))
def test_at_most_two_challenges_are_remembered(heard: list[bytes]) -> None:
    verifier = Verifier(KEY)
    for one in heard:
        verifier.receive(one)
    assert len(verifier._taken) <= 2


def test_a_signer_is_ready_once_it_has_heard_the_robot() -> None:
    signer = Signer(KEY)
    assert not signer.ready
    signer.receive(b"")
    assert signer.ready
    assert signer.sign(TOPIC, b"go") == b""


@pytest.mark.parametrize(
    ("payload", "needed"),
    [
        (StopRequest(0.0, "operator", latched=True), False),
        (StopRequest(0.0, "operator", latched=False), True),
        *((OperatorCommand(0.0, operation), True) for operation in Operation),
    ],
)
def test_everything_but_a_stop_must_be_signed(payload: object, needed: bool) -> None:
    assert needs_signature(payload) is needed
