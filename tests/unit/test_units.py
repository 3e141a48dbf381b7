"""The systemd units of the boards: what runs where, in which order, and that systemd takes them as they are."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from common.config import BoardSection, Config, apart
from deploy.boards.layout import TARGET
from deploy.boards.units import unit_texts

EXPOSURE_MAX = 2.5  # of 10, by `systemd-analyze security`
PYTHON = Path("/usr/bin/python3")
needs_systemd = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None or not PYTHON.exists(), reason="needs: apt install systemd python3"
)
PI_ALONE = Config(beaglebone=BoardSection(), raspberry=BoardSection(("bridge", "comm+mmu+planner", "poi")))
PLACINGS = {
    "beaglebone": (Config(), "beaglebone"),
    "raspberry": (Config(), "raspberry"),
    "pi_alone": (PI_ALONE, "raspberry"),
    "apart": (apart(Config()), "beaglebone"),
}


def units(placing: str) -> dict[str, dict[str, list[str]]]:
    """Unit -> key -> values."""
    config, board = PLACINGS[placing]
    parsed: dict[str, dict[str, list[str]]] = {}
    for name, text in unit_texts(config, board).items():
        lines = [line.partition("=") for line in text.splitlines() if "=" in line]
        parsed[name] = {key: [v for k, _, v in lines if k == key] for key, _, _ in lines}
    return parsed


def test_every_process_of_the_board_has_a_service_and_the_target_wants_them_all() -> None:
    found = units("beaglebone")
    services = ["indoor-mapping-bridge.service", "indoor-mapping-comm-mmu-planner.service"]
    assert list(found) == [*services, TARGET]
    assert found[TARGET]["Wants"] == [" ".join(services)]
    assert all(found[service]["PartOf"] == [TARGET] for service in services)
    assert "-m onboard comm+mmu+planner --config" in found[services[1]]["ExecStart"][0]


def test_bridge_and_comm_come_first_in_order_and_in_weight() -> None:
    found = units("apart")
    bridge, comm, mmu = (found[f"indoor-mapping-{module}.service"] for module in ("bridge", "comm", "mmu"))
    assert "indoor-mapping" not in bridge["After"][0]
    assert "indoor-mapping-bridge.service" in comm["After"][0]
    assert {"indoor-mapping-bridge.service", "indoor-mapping-comm.service"} <= set(mmu["After"][0].split())
    assert int(bridge["CPUWeight"][0]) > int(comm["CPUWeight"][0]) > int(mmu["CPUWeight"][0])
    assert int(bridge["Nice"][0]) < int(comm["Nice"][0]) < int(mmu["Nice"][0])


def test_the_beaglebone_has_the_memory_that_its_processes_may_take() -> None:
    found = units("beaglebone")
    assert sum(int(unit["MemoryMax"][0].rstrip("M")) for unit in found.values() if "MemoryMax" in unit) < 512


def test_only_the_bridge_reaches_serial_ports_and_only_poi_the_camera() -> None:
    found = units("pi_alone")
    devices = {name: " ".join(unit.get("DeviceAllow", [])) for name, unit in found.items()}
    assert [name for name, allowed in devices.items() if "ttyACM" in allowed] == ["indoor-mapping-bridge.service"]
    assert [name for name, allowed in devices.items() if "video" in allowed] == ["indoor-mapping-poi.service"]
    assert found["indoor-mapping-comm-mmu-planner.service"]["PrivateDevices"] == ["yes"]


def test_a_laptop_that_only_looks_on_has_no_units() -> None:
    assert unit_texts(Config(), "laptop") == {}


@needs_systemd
@pytest.mark.parametrize("placing", PLACINGS)
def test_systemd_takes_the_units_as_they_are(placing: str, tmp_path: Path) -> None:
    config, board = PLACINGS[placing]
    files = []
    for name, text in unit_texts(config, board).items():
        files.append(tmp_path / name)
        files[-1].write_text(text, encoding="utf-8")
    verified = subprocess.run(["systemd-analyze", "verify", *files], capture_output=True, text=True, check=False)
    assert (verified.returncode, verified.stderr) == (0, "")
    for file in files:
        if file.suffix == ".service":
            bound = ["--offline=true", f"--threshold={EXPOSURE_MAX * 10:.0f}"]
            command = ["systemd-analyze", "security", "--no-pager", *bound, str(file)]
            exposed = subprocess.run(command, capture_output=True, text=True, check=False)
            assert exposed.returncode == 0, exposed.stdout[-200:] + exposed.stderr


@needs_systemd
def test_a_misspelled_key_would_be_found(tmp_path: Path) -> None:
    file = tmp_path / "indoor-mapping-bridge.service"
    text = unit_texts(Config(), "beaglebone")[file.name]
    file.write_text(text.replace("WatchdogSec", "WatchdogSeconds"), encoding="utf-8")
    verified = subprocess.run(["systemd-analyze", "verify", file], capture_output=True, text=True, check=False)
    assert "WatchdogSeconds" in verified.stderr
