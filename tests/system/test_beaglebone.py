"""What a BeagleBone gets, in its own Debian: the assembled tree under an emulated ARM, with Debian's Python and numpy.

Two minutes for each Debian, the first time four or more, for its root folder. An emulated ARM is about ten times slower
than this machine, a BeagleBone two or three times slower than that: no time is asserted here.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common.config import BridgeSection, Config, MeshSection
from common.config_file import config_text
from common.messages.topics import ODOMETRY, RANGES
from deploy.boards.layout import CURRENT, PYTHONPATH
from deploy.boards.tree import assemble
from offboard.evaluate.figures import map_figures, pose_figures
from offboard.evaluate.free_space import FreeSpace, wall_samples
from offboard.runs.run_database import RunReader
from offboard.runs.run_folder import read_tum
from offboard.simulator.run.options import FLOORS
from tests.system.conftest import ROOT, environment, free_endpoint, run_cli, until
from tests.system.debian import CACHE, Chroot, debian_root, need, need_arm, over

pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]
SUITES = {12: "bookworm", 13: "trixie"}
PACKAGES = ("python3", "python3-numpy", "python3-scipy", "python3-msgpack", "python3-serial")
FLOOR = FLOORS / "loop.json"
SAME_M = 0.005
REPLAY, MESH = "tests/system/mapping_replay.py", "tests/system/board_mesh.py"
SOURCES = "/sources"  # of the tests' own programs, inside
INSIDE = {"PYTHONPATH": f"{PYTHONPATH}:{SOURCES}", "PYTHONDONTWRITEBYTECODE": "1", "OMP_NUM_THREADS": "1"}


@pytest.fixture(scope="module", params=SUITES, ids=SUITES.values())
def board(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chroot]:
    need("unshare=util-linux", "ip=iproute2", "mmdebstrap")
    need_arm()
    config = Config()
    config = replace(config, beaglebone=replace(config.beaglebone, debian=request.param))
    made = assemble(config, ["beaglebone"], CACHE, print)["beaglebone"]
    root = debian_root("armhf", SUITES[request.param], PACKAGES)
    with over(root, tmp_path_factory.mktemp("layer")) as merged:
        shown = {made.own / "app": f"{CURRENT}/app", made.site: f"{CURRENT}/site", ROOT / "tests": f"{SOURCES}/tests"}
        yield Chroot(merged, shown)


def in_python(board: Chroot, *words: str, timeout_s: float) -> str:
    done = board.run("python3", *words, timeout_s=timeout_s, **INSIDE)
    assert done.returncode == 0, (done.stdout + done.stderr)[-4000:]
    return done.stdout


def test_the_assembled_tree_and_debians_packages_fit_together(board: Chroot) -> None:
    modules = ("zenoh", "serial", "msgpack", "numpy", "scipy.sparse.linalg", "filterpy.kalman")
    modules += (
        "onboard.__main__",
        "onboard.bridge.bridge",
        "onboard.comm.comm",
        "onboard.mmu.mmu",
        "onboard.planner.planner",
    )
    report = f"import platform, sys, {', '.join(modules)}; print(platform.machine(), 'matplotlib' in sys.modules)"
    assert in_python(board, "-c", report, timeout_s=300.0).split() == ["armv7l", "False"]


@contextmanager
def robot_body(folder: Path, config: Config) -> Iterator[Path]:
    """The firmware's core and the simulated robot behind a serial port of this machine."""
    (folder / "robot.toml").write_text(config_text(config), encoding="utf-8")
    arguments = ["--config", folder / "robot.toml", "--log-dir", folder, "--run-dir", folder, "--floor", FLOOR]
    program = [sys.executable, "-m", "offboard.simulator", *map(str, arguments)]
    with subprocess.Popen(program, env=environment(), cwd=ROOT, stderr=subprocess.DEVNULL) as body:
        try:
            port = folder / "serial"
            until(port.exists, 60.0, "the serial port")
            yield Path(os.readlink(port))
        finally:
            body.kill()


def test_every_process_starts_and_the_robot_may_move(board: Chroot, tmp_path: Path) -> None:
    mesh = MeshSection(router=free_endpoint(), laptop_router=free_endpoint())
    config = Config(mesh=mesh, bridge=BridgeSection(serial_port=str(tmp_path / "serial")))
    with robot_body(tmp_path, config) as port:
        # The emulator knows usual speeds only (no TCSETS2), and a PTY has none
        there = replace(config, bridge=BridgeSection(serial_port=str(port), baud=115_200))
        (board.root / "robot.toml").write_text(config_text(there), encoding="utf-8")
        (board.root / "state").mkdir()
        said = in_python(board, f"{SOURCES}/{MESH}", "/robot.toml", "/state", timeout_s=600.0)
    assert said.strip() == "permit: granted; exit codes [0, 0]"


@dataclass(frozen=True)
class Drive:
    """A simulated run: what the sensors measured, as a file; the true path; the walls."""

    log: Path
    truth_s: Any
    truth: Any
    walls: Any


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Drive:
    run = tmp_path_factory.mktemp("run") / "loop"
    arguments = ["simulate", "--floor", "loop", "--seed", "1", "--camera", "off", "--out", str(run)]
    done = run_cli(*arguments, timeout_s=600.0)
    assert done.returncode == 0, done.stderr
    log = run / "log.jsonl"
    with RunReader(run) as reader, log.open("w", encoding="utf-8") as file:
        for message in reader.messages(ODOMETRY, RANGES):
            file.write(json.dumps({name: without_nan(v) for name, v in asdict(message.payload).items()}) + "\n")
    floor = json.loads(FLOOR.read_text(encoding="utf-8"))
    walls, _ = wall_samples(floor, FreeSpace(floor))
    return Drive(log, *read_tum(run / "truth.tum"), walls)


def without_nan(value: Any) -> Any:
    return [None if math.isnan(v) else v for v in value] if isinstance(value, (list, tuple)) else value


@dataclass(frozen=True)
class Mapped:
    """The figures of a replay, and the loop closures that were adopted."""

    ate_m: float
    map_rmse_m: float
    closures: list[str]
    cost_s: float

    @classmethod
    def of(cls, result: Path, drive: Drive) -> Mapped:
        with np.load(result) as file:
            at = [np.interp(drive.truth_s, file["times_s"], file["online"][:, i]) for i in range(2)]
            estimate = np.column_stack([*at, np.zeros(len(drive.truth))])
            errors, fit = pose_figures(estimate, drive.truth)
            rmse_m = map_figures(fit.transform(file["points"]), drive.walls)["map_rmse_m"]
            adopted = [line.partition(" overlap")[0] for line in file["closures"].tolist() if "adopted" in line]
            return cls(errors["ate_fit_m"], rmse_m, adopted, float(file["cost_s"]))


def test_the_mapping_unit_maps_as_here(board: Chroot, drive: Drive, tmp_path: Path) -> None:
    arguments = [sys.executable, str(ROOT / REPLAY), str(drive.log), str(tmp_path / "here.npz")]
    subprocess.run(arguments, env=environment() | {"OMP_NUM_THREADS": "1"}, cwd=ROOT, check=True)
    (board.root / "log.jsonl").write_bytes(drive.log.read_bytes())
    began_s = time.monotonic()
    in_python(board, f"{SOURCES}/{REPLAY}", "/log.jsonl", "/there.npz", timeout_s=1800.0)
    here, there = Mapped.of(tmp_path / "here.npz", drive), Mapped.of(board.root / "there.npz", drive)
    print(
        f"\nhere: ate {here.ate_m:.4f} m, map rmse {here.map_rmse_m:.4f} m, {len(here.closures)} closures; "
        f"there: ate {there.ate_m:.4f} m, map rmse {there.map_rmse_m:.4f} m, {len(there.closures)} closures; "
        f"processor time there {there.cost_s:.1f} s, {there.cost_s / here.cost_s:.1f} times as here "
        f"({time.monotonic() - began_s:.0f} s by the clock)"
    )
    assert len(here.closures) > 10
    assert there.closures == here.closures
    assert abs(there.ate_m - here.ate_m) < SAME_M
    assert abs(there.map_rmse_m - here.map_rmse_m) < SAME_M
