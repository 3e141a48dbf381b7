"""Memory and processor of a module over the last ten minutes."""

from __future__ import annotations

import time

from common.bus import LocalMesh
from common.messages.health import Status
from common.messages.topics import STATUS
from common.status import StatusReporter
from offboard.command_center.module_health import bars, health_text
from offboard.operate.health_history import KEPT_S, SAMPLE_S, HealthHistory, Sample


def report(memory_kb: int, cpu_share: float) -> Status:
    return Status(0.0, "RUN", 0, memory_kb, True, 1, cpu_share=cpu_share)


def test_the_most_of_each_ten_seconds_is_kept_for_ten_minutes() -> None:
    history = HealthHistory()
    for tick in range(9000):
        history.add(report(1024 * (60 + tick // 1000), 0.9 if tick == 8000 else 0.1), 0.1 * tick)
    assert len(history.samples) == KEPT_S / SAMPLE_S
    assert history.samples[0].memory_kb == 1024 * 62
    assert max(sample.cpu_share for sample in history.samples) == 0.9


def test_the_words_have_least_and_most_and_how_it_went() -> None:
    samples = [Sample(1024 * (60 + k), 0.04 * k) for k in range(6)]
    assert health_text(samples) == "memory 60 to 65 MB ▇█████ · cpu 0 to 20 % ▁▂▄▅▇█ · last 1 min"
    assert health_text([Sample(6, 0.0)]) == "memory 6 kB █"
    assert health_text([]) == ""


def test_a_long_history_has_few_bars_and_the_newest_is_the_last() -> None:
    assert bars([*[0.0] * 59, 1.0]) == "▁" * 19 + "█"
    assert bars([0.0]) == "▁"


def test_a_process_reports_how_much_of_a_core_it_uses() -> None:
    reporter = StatusReporter("mmu")
    seen: list[Status] = []
    bus = _Remembering(seen)
    used_s = time.process_time()
    reporter.report(bus, 0.0, state="RUN", ready=True)  # type: ignore[arg-type]
    while time.process_time() - used_s < 0.2:
        pass
    reporter.report(bus, 2.0, state="RUN", ready=True)  # type: ignore[arg-type]
    assert seen[0].cpu_share == 0.0
    assert 0.05 < seen[1].cpu_share <= 4.0


def test_in_lockstep_none_is_measured_for_a_run_must_repeat_to_the_bit() -> None:
    mesh = LocalMesh()
    node, others = mesh.endpoint("mmu"), mesh.endpoint("others")
    others.take(STATUS["mmu"])
    reporter = StatusReporter("mmu")
    for now_s in (0.0, 2.0, 4.0):
        reporter.report(node, now_s, state="RUN", ready=True)
    assert {status.cpu_share for status in others.take(STATUS["mmu"])} == {0.0}


class _Remembering:
    """A bus to other processes."""

    def __init__(self, seen: list[Status]) -> None:
        self._seen = seen

    def publish(self, _: object, payload: Status, *, news: bool = True) -> None:
        self._seen.append(payload)
