"""How processes and boards are: status, load, log lines, the shared clock."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from common.fields import (
    BootIds,
    Celsius,
    Count,
    CpuShare,
    ErrorNumber,
    Formerly,
    Load,
    Pace,
    Seconds,
    Sequences,
    Text,
    Topics,
    Word,
)


@dataclass(frozen=True, slots=True)
class Status:
    """State, error code and memory of a module (CC_MR_03), ten times a second."""

    t_s: Seconds
    state: Word
    error_code: ErrorNumber
    memory_kb: Count
    ready: bool
    heartbeat_count: Annotated[Count, Formerly("beats")]  # passes of the module's own loop
    detail: Text = ""
    valid: bool = True
    cpu_share: CpuShare = 0.0  # of its process, over the last second; 0 where nobody measures it


@dataclass(frozen=True, slots=True)
class BoardState:
    """How a computer of the robot is: what a person looks at before trusting it with a long run."""

    t_s: Seconds
    name: Word  # as the computer calls itself
    release: Word  # of the programs, as `deploy` named it
    uptime_s: Seconds
    load: Load  # mean of a minute
    temperature_c: Celsius  # of its hottest part
    disk_free_mb: Count  # where it keeps what must outlive a restart
    wall_s: Seconds  # since 1970 by its own clock: the laptop judges by its own how far off that is
    valid: bool = True


@dataclass(frozen=True, slots=True)
class LogLine:
    t_s: Seconds
    level: Word
    text: Text
    valid: bool = True


@dataclass(frozen=True, slots=True)
class ClockTick:
    """Simulated time, under `local --speed N` only, and what was published before it: newest message of each topic."""

    t_s: Seconds
    speed: Pace
    topics: Topics = ()
    boot_ids: BootIds = ()
    sequences: Sequences = ()
    valid: bool = True


@dataclass(frozen=True, slots=True)
class ClockAck:
    """A process has nothing to do before `t_s` of simulated time: the clock may go there, and a little further.

    With it, what the process published since its last ClockAck.
    """

    t_s: Seconds
    module: Word
    topics: Topics = ()
    boot_ids: BootIds = ()
    sequences: Sequences = ()
    valid: bool = True
