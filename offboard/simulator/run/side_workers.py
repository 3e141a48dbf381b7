"""What works beside the nodes of a run in lockstep: in their thread between two steps, or in processes of its own.

Either way an outcome comes after the same simulated time, and the run is the same to the bit.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from common.config import PoiSection
from common.side_work import JobOutcome, Work
from offboard.simulator.run.awaited_work import AwaitedWorker
from offboard.simulator.stopwatch import Stopwatch
from onboard.mmu.back_end import map_builder
from onboard.mmu.back_end.back_end_link import BackEndWorker
from onboard.mmu.back_end.map_builder import MapBuilder
from onboard.planner.grid import deliberation
from onboard.planner.grid.deliberation import Deliberator
from onboard.poi.poi import reader_of
from onboard.poi.signs import reading_job
from onboard.poi.signs.reading_job import Finding, Job, Reading, ReadingWorker


@dataclass(frozen=True, slots=True)
class SideWorkers:
    """Of one run. `work` does what waits, where that is in the thread of the nodes."""

    back_end: BackEndWorker
    deliberator: Deliberator
    reading: Callable[[PoiSection], ReadingWorker]  # loads the models: only for a robot with a camera
    work: Callable[[], None] = lambda: None


def in_thread() -> SideWorkers:
    """No step of a node contains the work of back end and deliberator."""
    back_end, deliberator = map_builder.deferred_back_end(), deliberation.deferred_deliberator()

    def work() -> None:
        back_end.work()
        deliberator.work()

    return SideWorkers(
        back_end, deliberator, lambda section: reading_job.deferred_reading(lambda: reader_of(section)), work
    )


def apart(stopwatch: Stopwatch, reading_s: float | None = None) -> SideWorkers:
    """On another core, while the nodes go on. `reading_s`: what poi's board takes to read one photo, see RunOptions."""
    return SideWorkers(
        AwaitedWorker(stopwatch, map_builder.LATENCY_S, lambda: MapBuilder().correction),
        AwaitedWorker(stopwatch, deliberation.LATENCY_S, deliberation.load),
        partial(_ReadingApart, stopwatch, reading_s),
    )


class _ReadingApart:
    """The frame of a job goes there, and stays here for what comes back.

    A board that takes `reading_s` begins a job when it is done with those before.
    """

    ready = True

    def __init__(self, stopwatch: Stopwatch, reading_s: float | None, section: PoiSection) -> None:
        def load() -> Work[Job, tuple[Finding, ...]]:
            read = reader_of(section)
            return lambda job: read(job).findings

        latency_s = reading_job.LATENCY_S if reading_s is None else reading_s
        self._worker: AwaitedWorker[Job, tuple[Finding, ...]] = AwaitedWorker(stopwatch, latency_s, load)
        self._jobs: deque[Job] = deque()
        self._reading_s, self._free_s = reading_s, 0.0

    @property
    def pending(self) -> int:
        return self._worker.pending

    @property
    def busy(self) -> bool:
        return self._worker.busy

    def begin(self, job: Job, now_s: float) -> None:
        self._jobs.append(job)
        if self._reading_s is not None:
            now_s = max(now_s, self._free_s)
            self._free_s = now_s + self._reading_s
        self._worker.begin(job, now_s)

    def result(self, now_s: float) -> JobOutcome[Reading] | None:
        return self._of_job(self._worker.result(now_s))

    def due_s(self, now_s: float) -> float:
        return self._worker.due_s(now_s)

    def close(self) -> JobOutcome[Reading] | None:
        return self._of_job(self._worker.close())

    def _of_job(self, outcome: JobOutcome[tuple[Finding, ...]] | None) -> JobOutcome[Reading] | None:
        if outcome is None or outcome.value is None:
            return None
        return JobOutcome(Reading(self._jobs.popleft(), outcome.value))
