"""The robot's real programs, put onto a board by the command line and reached over TLS. Takes two minutes."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from common.clock import FreeClock
from common.config import BoardSection, BridgeSection, Config, MeshSection, PoiSection
from common.config_file import config_text
from common.messages.topics import PERMIT, STATUS
from common.zenoh_bus import ZenohBus
from deploy.boards import layout
from tests.system.board_machine import board_machines
from tests.system.conftest import run_cli, until

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


def test_from_a_bare_board_to_a_robot_that_reports_over_tls(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with board_machines(tmp_path, monkeypatch, "board-a") as (machine,):
        config = Config(
            mesh=MeshSection(
                listen="tls/0.0.0.0:7449", robot=f"tls/{machine.link.there}:7449", keys=str(tmp_path / "keys")
            ),
            beaglebone=replace(Config().beaglebone, ssh="board-a", platform="x86_64"),
            raspberry=BoardSection(("poi",)),
            bridge=BridgeSection(serial_port="/dev/null"),
            poi=PoiSection(source="unix:frames"),
        )
        file = tmp_path / "robot.toml"
        file.write_text(config_text(config), encoding="utf-8")

        def deploy(*words: str) -> str:
            done = run_cli("deploy", *words, "--config", str(file), timeout_s=600.0)
            assert done.returncode == 0, done.stdout + done.stderr
            return done.stdout

        assert "Keys valid until" in deploy("bootstrap")
        assert "Nothing stands in the way on beaglebone." in deploy("check")
        pushed = deploy("push")
        print(pushed)
        assert "beaglebone: runs " in pushed
        shown = deploy("status")
        print(shown)
        assert "indoor-mapping-comm-mmu-planner.service: active, 0 restarts" in shown
        release = shown.partition("release ")[2].partition(",")[0]
        with closing(ZenohBus("command_center", config, FreeClock(), "client")) as bus:
            until(
                lambda: bus.latest(STATUS["planner"]) is not None and bus.latest(PERMIT) is not None, 60.0, "a status"
            )
            permit = bus.latest(PERMIT)
            assert permit is not None
            assert not permit.granted  # there is no board behind the serial port
            assert {known.name for module, known in bus.alive_releases() if module == "planner"} == {release}
        assert machine.run(f"cat {layout.RUNTIME}/permit") == "withheld"
        assert f"runs {release} already" in deploy("push")
        assert "started" in deploy("logs")
        assert "stopped" in deploy("stop")
        assert "active" not in deploy("status").replace("inactive", "")
