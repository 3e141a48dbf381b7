"""What `deploy` makes of robot.toml, of a board's answer and of pip's packages, before and without any board."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from common.config import BoardSection, Config, MeshSection
from common.errors import StartError
from common.release import RELEASE_FILE
from deploy.boards import checks, tree
from deploy.boards.layout import KEYS, boards_in_use, modules_on, unit_name
from deploy.boards.platforms import wheel_platforms
from deploy.boards.probe import Facts, parse
from deploy.boards.services import status_lines
from deploy.boards.ssh import last_line
from deploy.boards.tree import assemble, debian_packages
from deploy.cli import main
from deploy.verbs.keys import hosts_of_config

ANSWER = """
uname=armv7l
debian=12
python=3.11
free_kb=1500000
user=indoor-mapping
release=abc-123
good=abc-123 abc-122
permit=granted
uptime_s=86400.5
load=0.42
temperature_mc=51200
systemd=running
missing:avrdude=1
unit:indoor-mapping-bridge.service=active 0
unit:indoor-mapping-comm-mmu-planner.service=3 failed
there:/dev/ttyACM0=1
"""
CONFIG = replace(
    Config(), beaglebone=replace(Config().beaglebone, ssh="debian@10.0.0.2"), raspberry=BoardSection(("poi",))
)


def sound(**change: object) -> Facts:
    """A BeagleBone on which all is well, but for the change."""
    facts = replace(parse(ANSWER.replace("granted", "withheld"), 0.01), missing_packages=())
    return replace(facts, **change)  # type: ignore[arg-type]


def test_a_board_with_an_address_and_processes_is_in_use() -> None:
    assert boards_in_use(Config()) == ()
    assert boards_in_use(CONFIG) == ("beaglebone",)
    assert boards_in_use(replace(CONFIG, beaglebone=BoardSection(ssh="x"))) == ()
    assert modules_on(CONFIG, "beaglebone") == ("bridge", "comm", "mmu", "planner")
    assert unit_name("comm+mmu") == "indoor-mapping-comm-mmu.service"


def test_wheels_are_taken_up_to_the_c_library_of_the_board_and_not_beyond() -> None:
    bookworm = wheel_platforms(BoardSection(platform="armv7l", debian=12))
    trixie = wheel_platforms(BoardSection(platform="aarch64", debian=13))
    assert bookworm[0] == "manylinux_2_36_armv7l"
    assert {"manylinux2014_armv7l", "linux_armv7l"} <= set(bookworm)
    assert trixie[0] == "manylinux_2_41_aarch64"


def test_what_a_board_answers_becomes_facts_and_lines_for_a_person() -> None:
    facts = parse(ANSWER, -0.31)
    assert facts.may_move
    assert facts.missing_packages == ("avrdude",)
    assert facts.files == {"/dev/ttyACM0"}
    assert status_lines(facts) == [
        "release abc-123, up 24 h, load 0.42, 51 °C, 1.5 GB free, clock -0.31 s, permit granted",
        "  indoor-mapping-bridge.service: active, 0 restarts",
        "  indoor-mapping-comm-mmu-planner.service: failed, 3 restarts",
    ]


def test_an_answer_of_nothing_is_read_as_well() -> None:
    facts = parse("", 0.0)
    assert not facts.may_move
    assert "beaglebone does not run systemd." in checks.fatal_problems(CONFIG, "beaglebone", facts)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"platform": "aarch64"}, "beaglebone is aarch64; [beaglebone] platform of robot.toml is armv7l."),
        ({"debian": "13"}, "beaglebone has Debian 13; [beaglebone] debian of robot.toml is 12."),
        ({"python": "3.13"}, "/usr/bin/python3 of beaglebone is 3.13; Debian 12 has 3.11."),
        ({"has_systemd": False}, "beaglebone does not run systemd."),
        ({"missing_packages": ("rsync",)}, "beaglebone lacks rsync: run `deploy bootstrap`."),
        ({"has_user": False}, "beaglebone has no user for the services: run `deploy bootstrap`."),
        ({"files": frozenset()}, "beaglebone has no /dev/ttyACM0."),
        ({"clock_offset_s": -86400.0}, "The clock of beaglebone is -86400.0 s off: run `deploy clock --set`."),
    ],
)
def test_check_names_what_is_wrong_with_a_board(change: dict[str, object], complaint: str) -> None:
    assert checks.board_problems(CONFIG, "beaglebone", sound()) == []
    assert checks.board_problems(CONFIG, "beaglebone", sound(**change)) == [complaint]


def test_check_names_what_is_wrong_on_this_machine(tmp_path: Path) -> None:
    assert [line.partition(":")[0] for line in checks.local_problems(Config(), lambda _: None)] == [
        "ssh is missing",
        "rsync is missing",
        'No board has an address',
    ]  # fmt: skip
    away = "comm runs on beaglebone, and raspberry and laptop must reach it: set [mesh] listen and robot."
    assert checks.local_problems(CONFIG, lambda _: "there") == [away]
    mesh = MeshSection(listen="tls/0.0.0.0:7449", robot="tls/10.0.0.2:7449", keys=str(tmp_path))
    problems = checks.local_problems(replace(CONFIG, mesh=mesh), lambda _: "there")
    assert [f"{tmp_path}/{role}/authority.pem is missing" in p for role, p in zip(
        ("robot", "laptop", "command_center"), problems, strict=True
    )] == [True] * 3  # fmt: skip


def test_boards_of_two_releases_and_a_robot_that_may_move_are_named() -> None:
    two = {"beaglebone": sound(), "raspberry": sound(release="def-456", good=("def-456",))}
    (different,) = checks.release_problems(two)
    assert "beaglebone runs abc-123, raspberry runs def-456" in different
    (unseen,) = checks.release_problems({"beaglebone": sound(good=("abc-122",))})
    assert unseen.startswith("beaglebone was switched to abc-123 and not seen to run well since")
    assert checks.release_problems({"beaglebone": sound(), "raspberry": sound(release="")}) == []
    assert checks.motion_problems(sound(), "beaglebone") == []
    assert "The robot may move" in checks.motion_problems(sound(permit="granted"), "beaglebone")[0]
    assert "it is unknown whether the robot may move" in checks.motion_problems(None, "beaglebone")[0]


def test_the_beaglebone_gets_from_debian_what_has_no_wheel_there() -> None:
    assert {"python3-numpy", "python3-msgpack", "rsync", "avrdude"} <= set(debian_packages(CONFIG, "beaglebone"))
    assert debian_packages(replace(CONFIG, raspberry=BoardSection(("poi",), "pi", "aarch64")), "raspberry") == [
        "python3", "rsync", "python3-picamera2",
    ]  # fmt: skip


class Pip:
    """Puts packages into the target folder, in these versions; fails for those that it does not have."""

    def __init__(self, versions: dict[str, str]) -> None:
        self.versions = versions
        self.calls: list[Sequence[str]] = []

    def run(self, command: Sequence[str], **_: object) -> subprocess.CompletedProcess[str]:
        if "pip" not in command:  # git
            return subprocess.CompletedProcess(command, 0, "abc1234\n", "")
        self.calls.append(command)
        target = Path(command[command.index("--target") + 1])
        for name in command[command.index("-c") + 2 :]:
            if name.startswith("--"):
                continue
            if name not in self.versions:
                return subprocess.CompletedProcess(
                    command, 1, "", f"ERROR: No matching distribution found for {name}\n"
                )
            folder = target / f"{name.replace('-', '_')}-{self.versions[name]}.dist-info"
            folder.mkdir(parents=True)
            (folder / "METADATA").write_text(f"Name: {name}\nVersion: {self.versions[name]}\n")
        return subprocess.CompletedProcess(command, 0, "", "")


@pytest.fixture
def pip(monkeypatch: pytest.MonkeyPatch) -> Pip:
    made = Pip(dict(tree._pins()))
    monkeypatch.setattr(tree.subprocess, "run", made.run)  # type: ignore[attr-defined]
    return made


def test_a_tree_has_programs_packages_units_and_settings_and_the_same_content_has_the_same_name(
    pip: Pip, tmp_path: Path
) -> None:
    config = replace(CONFIG, mesh=replace(CONFIG.mesh, keys="keys"))
    made = assemble(config, ("beaglebone",), tmp_path, lambda _: None)["beaglebone"]
    assert (made.own / "app" / "onboard" / "comm" / "comm.py").exists()
    assert (made.own / "app" / RELEASE_FILE).read_text() == f"{made.release}\n"
    assert f'keys = "{KEYS}"' in (made.own / "robot.toml").read_text()
    assert (made.own / "units" / "indoor-mapping-bridge.service").exists()
    calls = len(pip.calls)
    again = assemble(config, ("beaglebone",), tmp_path, lambda _: None)["beaglebone"]
    assert (again.release, len(pip.calls)) == (made.release, calls)
    other = replace(config, bridge=replace(config.bridge, serial_port="/dev/ttyUSB0"))
    assert assemble(other, ("beaglebone",), tmp_path, lambda _: None)["beaglebone"].release != made.release


def test_some_boards_get_the_release_that_all_would_get(pip: Pip, tmp_path: Path) -> None:
    config = replace(CONFIG, raspberry=BoardSection(("poi",), "pi", "aarch64"))
    boards = ("raspberry", "beaglebone")
    made = [assemble(config, chosen, tmp_path, lambda _: None) for chosen in (boards, *((board,) for board in boards))]
    assert len({tree.release for trees in made for tree in trees.values()}) == 1


def test_a_package_without_a_wheel_and_one_of_another_version_end_in_a_sentence(pip: Pip, tmp_path: Path) -> None:
    pip.versions["eclipse-zenoh"] = "0.10.0rc0"
    with pytest.raises(StartError, match=r"with eclipse-zenoh 0\.10\.0rc0, unlike constraints\.txt"):
        assemble(CONFIG, ("beaglebone",), tmp_path, lambda _: None)
    del pip.versions["eclipse-zenoh"]
    with pytest.raises(StartError, match=r"pip has no packages for armv7l, Python 3\.11: No matching distribution"):
        assemble(CONFIG, ("beaglebone",), tmp_path, lambda _: None)
    assert not list((tmp_path / "sites").iterdir())


def test_keys_are_made_for_the_address_in_robot_toml() -> None:
    assert hosts_of_config(Config(mesh=MeshSection(robot="tls/10.0.0.2:7449"))) == {"robot": ["10.0.0.2"]}
    with pytest.raises(StartError, match=r"Set \[mesh\] robot"):
        hosts_of_config(Config())


def test_deploy_without_boards_is_one_sentence_and_exit_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "robot.toml").write_text("")
    assert main(["deploy", "push", "--config", str(tmp_path / "robot.toml")]) == 2
    assert "No board has an address" in capsys.readouterr().err


def test_the_end_of_what_a_program_wrote_is_safe_to_show() -> None:
    assert last_line("first\nlast.\n\n") == "last"
    assert last_line("") == "it gave no reason"
