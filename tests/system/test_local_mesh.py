"""`indoor-mapping local`: the whole mesh with the simulator, started, disturbed and ended from outside."""

from __future__ import annotations

import json
import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.system.conftest import children_of, local_run, run_cli, until

pytestmark = pytest.mark.timeout(90)


@pytest.fixture
def local(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A headless run whose mission has started; `tmp_path / "run"` is its folder."""
    with local_run(tmp_path / "run") as process:
        yield process


@pytest.mark.parametrize(
    "number", [pytest.param(signal.SIGINT, marks=pytest.mark.slow), signal.SIGTERM, signal.SIGKILL]
)
def test_no_process_is_left_when_local_ends(
    local: subprocess.Popen[str], tmp_path: Path, number: signal.Signals
) -> None:
    children = children_of(tmp_path / "run")
    assert set(children) >= {"simulator", "comm", "bridge", "mmu", "planner", "recorder"}
    # A frozen one must not stay either
    os.kill(children["mmu"], signal.SIGSTOP)
    local.send_signal(number)
    code = local.wait(45.0)
    assert code == (130 if number != signal.SIGKILL else -signal.SIGKILL)
    if number != signal.SIGKILL:
        summary = json.loads((tmp_path / "run" / "summary.json").read_text(encoding="utf-8"))
        assert summary["finished"] is False
        # The frozen one had to be killed and left nothing
        assert {"simulator", "bridge", "recorder"} <= set(summary["steps"])
    until(lambda: not children_of(tmp_path / "run"), 5.0, "the end of every process")


def test_a_folder_with_a_run_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "trajectory.tum").touch()
    result = run_cli("local", "--floor", "straight", "--headless", "--out", str(tmp_path))
    assert result.returncode == 2
    assert "holds a run already" in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["trajectory.tum"]
