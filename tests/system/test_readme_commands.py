"""The commands of the README, from the clone to `push`, as they stand there, onto two boards. Five minutes, and the
packages of the laptop and of the boards come from the network."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import time
import tomllib
from pathlib import Path

import pytest

from tests.system.board_machine import BoardMachine, board_machines
from tests.system.conftest import ROOT
from tests.system.switch import open_switch

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]
HEADING, CHAPTER = "### Onto the boards", ROOT / "docs" / "deployment.md"
ADDRESS_OF_THE_PROJECT = "<address of this repository>"
USERS = {"10.0.0.2": "debian", "10.0.0.3": "pi"}  # address -> user, as the chapter has them


def block_after(text: str, heading: str) -> str:
    """The first block of code below a heading."""
    return text.partition(f"{heading}\n")[2].partition("```\n")[2].partition("```")[0]


def commands() -> list[str]:
    """Of the README, a line each, without what is said beside them."""
    lines = block_after((ROOT / "README.md").read_text(encoding="utf-8"), HEADING).splitlines()
    return [line.partition(" #")[0].strip() for line in lines]


def robot_toml(addresses: dict[str, str]) -> str:
    """The lines of the chapter, for boards with these addresses, which are machines like this one; without a camera."""
    text = block_after(CHAPTER.read_text(encoding="utf-8"), "## robot.toml")
    for written, address in addresses.items():
        assert written in text
        text = text.replace(written, address)
    text, here = re.sub(r"debian = \d+\n", "", text), f'platform = "{os.uname().machine}"\ndebian = {debian()}\n'
    for board in ("beaglebone", "raspberry"):
        text = text.replace(f"[{board}]\n", f"[{board}]\n{here}")
    text += '\n[poi]\nsource = "unix:/run/frames"\n'
    assert set(tomllib.loads(text)) == {"mesh", "beaglebone", "raspberry", "bridge", "comm", "poi"}
    return text


def debian() -> int:
    """The release of this machine's Debian."""
    release = Path("/etc/os-release").read_text(encoding="utf-8")
    found = re.search(r'^VERSION_ID="(1[23])"', release, re.MULTILINE)
    if found is None:
        pytest.skip("the boards are copies of this machine, which is neither Debian 12 nor 13")
    return int(found[1])


def give_user(machine: BoardMachine, user: str) -> None:
    """Who may log in by the key, and be root without a password."""
    machine.run(f"useradd -m -p '*' {user}; echo '{user} ALL=(ALL) NOPASSWD: ALL' > /etc/sudoers.d/{user}")


def test_five_commands_lead_from_a_clone_to_two_boards_that_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for tool in ("sudo", "git"):
        if shutil.which(tool) is None:
            pytest.skip(f"needs: apt install {tool}")
    if not (ROOT / ".git").exists():
        pytest.skip("these sources are no clone, so there is nothing to clone")
    lines = commands()
    assert len(lines) == 5
    switch = open_switch()
    try:
        with board_machines(tmp_path, monkeypatch, "one", "two", open_link=switch.plug) as machines:
            for machine, user in zip(machines, USERS.values(), strict=True):
                give_user(machine, user)
            settings = tmp_path / "robot.toml"
            settings.write_text(robot_toml({a: m.link.there for a, m in zip(USERS, machines, strict=True)}))
            assert lines[1].startswith("cd ")
            lines[1] += f" && cp {settings} robot.toml"
            lines[0] = lines[0].replace(ADDRESS_OF_THE_PROJECT, shlex.quote(str(ROOT)))
            said = run_lines(lines, tmp_path)
            print(said)
            assert "Keys valid until" in said
            assert re.search("raspberry: runs .*beaglebone: runs ", said, re.DOTALL)
            status = run_lines([".venv/bin/indoor-mapping deploy status"], tmp_path / "indoor-mapping")
            print(status)
            assert status.count(": active, 0 restarts") == 3
    finally:
        switch.close()


def run_lines(lines: list[str], folder: Path) -> str:
    """In one shell, which ends with the first that fails; what they wrote."""
    script = folder / "lines.sh"
    script.write_text("set -ex\n" + "\n".join(lines) + "\n", encoding="utf-8")
    own = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    began_s = time.monotonic()
    done = subprocess.run(
        ["bash", str(script)], cwd=folder, env=own,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    return f"{done.stdout}{time.monotonic() - began_s:.0f} s\n"
