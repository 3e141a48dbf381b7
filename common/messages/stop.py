"""May the robot move: permit and stop."""

from __future__ import annotations

from dataclasses import dataclass

from common.fields import Challenge, Epoch, Identity, Seconds, StopIds, StopSources, Text, Word


@dataclass(frozen=True, slots=True)
class Permit:
    """May the robot move? Granted only while every on-robot module is alive, fresh, valid and running, and the
    newest latched stop was released and followed by a resume."""

    t_s: Seconds
    granted: bool
    reason: Text
    stop_sources: StopSources = ()  # who holds the latched stop
    valid: bool = True
    challenge: Challenge = b""  # to sign commands over; empty where none need be
    stop_epoch: Epoch = 0  # grows with every latched stop; 0: comm does not know it yet
    stop_ids: StopIds = ()  # the newest stops that are latched in this epoch
    resumed: bool = True  # a resume was given since this epoch's stop was released
    life: Identity = 0  # of comm: another number after each restart


@dataclass(frozen=True, slots=True)
class StopRequest:
    """e-Stop command: latch the software stop, or release the epoch it names. Repeated until the robot confirms."""

    t_s: Seconds
    source: Word
    latched: bool
    valid: bool = True
    stop_id: Identity = 0  # of this press, drawn at random; its repeats carry the same
    epoch: Epoch = 0  # which stop is released: the `stop_epoch` that the person saw
