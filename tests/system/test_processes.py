"""How processes begin and end: bad input is one sentence and exit code 2, and nothing is left behind."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from common.config import MeshSection
from offboard.simulator.run.options import FLOORS
from tests.system.conftest import ROOT, Mesh, children_of, environment, free_endpoint, run_cli, running, until

pytestmark = pytest.mark.timeout(60)


def one_sentence(text: str) -> bool:
    return len(text.strip().splitlines()) == 1 and "Traceback" not in text


def test_a_taken_port_is_one_sentence_and_exit_code_2(mesh: Mesh) -> None:
    mesh.start("comm")
    until(lambda: "comm" in mesh.bus.alive_tokens())
    second = mesh.command("node", "comm", "--log-dir", str(mesh.folder))
    assert second.returncode == 2
    assert "Cannot listen on" in second.stderr
    assert one_sentence(second.stderr)
    assert mesh.processes["comm"].poll() is None


def test_an_unknown_key_is_one_sentence_and_exit_code_2(tmp_path: Path) -> None:
    config = tmp_path / "robot.toml"
    config.write_text("[mesh]\nruoter = 'x'\n", encoding="utf-8")
    result = run_cli("node", "comm", "--config", str(config))
    assert result.returncode == 2
    assert "robot.toml" in result.stderr
    assert "mesh.ruoter is not known" in result.stderr
    assert one_sentence(result.stderr)


def test_a_missing_serial_port_is_one_sentence_and_exit_code_2(mesh: Mesh) -> None:
    result = mesh.command("node", "bridge")
    assert result.returncode == 2
    assert "serial is not there" in result.stderr
    assert one_sentence(result.stderr)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("local", "--floor", "nowhere"), "no floor file nowhere"),
        (("local", "--speed", "fast"), "--speed"),
        (("node", "nobody"), "no process nobody"),
        (("dance",), "dance"),
        (("bench", "everything"), "no benchmark everything"),
        (("goto", "3,kitchen"), "X,Y"),
        (("deploy", "keys", "--to", "keys", "--machine", "cat=10.0.0.2"), "NAME=HOST_OR_IP"),
        (("start", "--config", "missing.toml"), "missing.toml cannot be read"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(arguments: tuple[str, ...], said: str, tmp_path: Path) -> None:
    result = run_cli(*arguments)
    assert result.returncode == 2
    assert said in result.stderr
    assert one_sentence(result.stderr)


def changed_floor(change: Callable[[dict[str, Any]], object]) -> str:
    """The project's own floor with something done to it."""
    floor: dict[str, Any] = json.loads((FLOORS / "straight.json").read_text(encoding="utf-8"))
    change(floor)
    return json.dumps(floor)


@pytest.mark.parametrize(
    ("verb", "text", "key"),
    [
        (
            "local",
            changed_floor(lambda floor: floor["corridor"].update(exterior=[[0, 4], [24, 4]])),
            "corridor.exterior",
        ),
        ("simulate", changed_floor(lambda floor: floor["doors"][0].update(y_m=5.0)), "doors[0]"),
        ("simulate", changed_floor(lambda floor: floor["doors"][0].pop("width_m")), "doors[0].width_m"),
        ("local", '{"name": ', "not JSON"),
    ],
    ids=["open polygon", "door off the wall", "missing key", "not JSON"],
)
def test_a_bad_floor_is_one_sentence_with_file_and_key_and_starts_nothing(
    tmp_path: Path, verb: str, text: str, key: str
) -> None:
    floor = tmp_path / "mine.json"
    floor.write_text(text, encoding="utf-8")
    result = run_cli(verb, "--floor", str(floor), "--out", str(tmp_path / "run"))
    assert result.returncode == 2
    assert "mine.json" in result.stderr
    assert key in result.stderr
    assert one_sentence(result.stderr)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.json"]


def test_a_process_that_cannot_begin_ends_local_with_its_sentence_and_leaves_none_behind(tmp_path: Path) -> None:
    # The simulator finds a folder where its log of the motors is to be
    (tmp_path / "run" / "process" / "motors.csv").mkdir(parents=True)
    result = run_cli("local", "--floor", "straight", "--headless", "--out", str(tmp_path / "run"))
    assert result.returncode == 2
    assert "motors.csv" in result.stderr
    assert one_sentence(result.stderr)
    assert children_of(tmp_path / "run") == {}


def test_a_verb_without_a_mesh_says_so(tmp_path: Path) -> None:
    config = tmp_path / "robot.toml"
    config.write_text(f'[mesh]\nrouter = "{free_endpoint()}"\n', encoding="utf-8")
    result = run_cli("estop", "--config", str(config))
    assert result.returncode == 2
    assert "No mesh answers" in result.stderr
    assert MeshSection().router not in result.stderr


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_process_ends_on_a_signal_and_takes_its_token_with_it(mesh: Mesh, number: signal.Signals) -> None:
    mesh.start("comm")
    mesh.start("mmu")
    until(lambda: {"comm", "mmu"} <= mesh.bus.alive_tokens())
    mesh.signal("mmu", number)
    assert mesh.processes["mmu"].wait(5.0) == 0
    until(lambda: "mmu" not in mesh.bus.alive_tokens(), 2.0)


def test_an_unexpected_error_ends_the_process_with_code_1_and_stands_in_its_log(tmp_path: Path, mesh: Mesh) -> None:
    program = tmp_path / "broken.py"
    program.write_text(
        "import sys\n"
        "from common.messages.topics import POSE\n"
        "from common.process import run\n"
        "class Broken:\n"
        "    name, period_s, wakes_on = 'mmu', 0.01, ()\n"
        "    def step(self, bus, now_s):\n"
        "        bus.take(POSE)\n"
        "        raise RuntimeError('quite unexpected')\n"
        "    def close(self): pass\n"
        "sys.exit(run('mmu', lambda config, arguments: Broken()))\n",
        encoding="utf-8",
    )
    process = mesh.start("mmu", str(program))
    assert process.wait(10.0) == 1
    assert "quite unexpected" in (tmp_path / "mmu.log").read_text(encoding="utf-8")


def test_children_end_with_the_process_that_started_them(tmp_path: Path) -> None:
    parent = tmp_path / "parent.py"
    parent.write_text(
        "import sys, time\n"
        "from pathlib import Path\n"
        "from deploy.local.supervisor import Supervisor\n"
        "supervisor = Supervisor(Path(sys.argv[1]))\n"
        "supervisor.start('comm', ('onboard.comm',), ['--config', sys.argv[2], '--log-dir', sys.argv[1]])\n"
        "print(supervisor.children['comm'].process.pid, flush=True)\n"
        "time.sleep(60)\n",
        encoding="utf-8",
    )
    config = tmp_path / "robot.toml"
    config.write_text(f'[mesh]\nrouter = "{free_endpoint()}"\n', encoding="utf-8")
    with subprocess.Popen(
        [sys.executable, str(parent), str(tmp_path), str(config)],
        env=environment(),
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        child = int(process.stdout.readline())
        log = tmp_path / "comm.log"
        until(lambda: log.exists() and "started" in log.read_text(encoding="utf-8"))
        process.kill()
        until(lambda: not running(child), 5.0, "the end of the child")
