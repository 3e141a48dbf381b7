"""A press of the software stop: what all who send one have in common, and load before anything else."""

from __future__ import annotations

from collections.abc import Callable

SOURCE = "operator"
REPEAT_S = 0.02  # the first message of a program that has just joined may get lost
_STOP_ID_BITS = 62


def new_stop_id(random_bits: Callable[[int], int]) -> int:
    """Of a press, drawn at random, so that several senders do not meet."""
    return random_bits(_STOP_ID_BITS)
