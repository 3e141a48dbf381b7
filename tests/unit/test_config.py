"""robot.toml: every mistake is one sentence that names file and key."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import get_type_hints

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.config import BridgeSection, Config, RobotSection
from common.config_file import ConfigError, config_text, load_config, parse_config
from common.constants import SONAR_BEARINGS_RAD


def test_empty_file_gives_the_defaults() -> None:
    assert parse_config("") == Config()
    assert load_config(None) == Config()


def test_the_section_of_a_board_needs_only_what_differs_from_that_boards_defaults() -> None:
    config = parse_config('[beaglebone]\nssh = "debian@10.0.0.2"\n[raspberry]\ndebian = 13\n')
    assert config.beaglebone == replace(Config().beaglebone, ssh="debian@10.0.0.2")
    assert config.raspberry == replace(Config().raspberry, debian=13)


def test_the_lines_of_the_chapter_on_deployment_are_enough() -> None:
    chapter = Path(__file__).resolve().parents[2] / "docs" / "deployment.md"
    lines = (
        chapter.read_text(encoding="utf-8").partition("## robot.toml\n")[2].partition("```\n")[2].partition("```")[0]
    )
    config = parse_config(lines)
    assert (config.board_of("comm"), config.board_of("poi")) == ("beaglebone", "raspberry")
    assert (config.beaglebone.platform, config.raspberry.platform) == ("armv7l", "aarch64")
    assert config.has_camera


def test_default_bearings_are_the_constants() -> None:
    assert Config().sonars.bearings_rad == pytest.approx(SONAR_BEARINGS_RAD)


def test_values_are_read_and_integers_serve_as_numbers() -> None:
    config = parse_config('[bridge]\nserial_port = "/dev/x"\n[wheels]\ntrack_m = 1\n[comm]\nrequired = ["mmu"]\n')
    assert config.bridge.serial_port == "/dev/x"
    assert config.wheels.track_m == 1.0
    assert config.comm.required == ("mmu",)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[bridge]\nbuad = 1", "r.toml: bridge.buad is not known"),
        ("[brigde]\n", "section [brigde] is not known"),
        ("bridge = 3", "r.toml: bridge must be a section"),
        ('[bridge]\nbaud = "fast"', "r.toml: bridge.baud must be a whole number"),
        ("[bridge]\nbaud = true", "r.toml: bridge.baud must be a whole number"),
        ("[comm]\nstop_when_offboard_missing = 1", "must be true or false"),
        ("[comm]\nrequired = [1]", "comm.required[0] must be text"),
        ('[comm]\nrequired = "mmu"', "comm.required must be a list"),
        ('[comm]\nrequired = ["mmmu"]', "comm.required names 'mmmu'"),
        ("[sonars]\nbearings_deg = [1.0]", "must hold 5 angles"),
        ("[wheels]\ndiameter_m = 66.0", "wheels.diameter_m must be between"),
        ("[visualizer]\nport = 70000", "visualizer.port must be between 0 and 65535"),
        ('[robot]\nname = "a/b"', "robot.name must be one word"),
        ('[mesh]\nrobot = "tcp/robot:7449"\nkeys = "k"', 'mesh.robot leaves this machine, so it must be "tls/HOST'),
        ('[mesh]\nrobot = "tls/robot"\nkeys = "k"', 'must be "tls/HOST:PORT"'),
        ('[mesh]\nlisten = "tls/0.0.0.0:7449"', "mesh.listen needs mesh.keys"),
        ("[robot", "r.toml is no valid TOML"),
        ("[" * 5000, "r.toml is no valid TOML"),
        (f"[bridge]\nbaud = {'9' * 5000}", "r.toml is no valid TOML"),
        (f"[wheels]\ntrack_m = {'9' * 400}", "wheels.track_m must be between 0.01 and 2"),
        (f"[bridge]\nbaud = 0x{'f' * 5000}", "bridge.baud must be between 1 and 10000000"),
        ("[wheels]\ndiameter_m = nan", "wheels.diameter_m must be between"),
        ("[sonars]\nbearings_deg = [0, 1, inf, 2, 3]", "sonars.bearings_deg[2] must be between -180 and 180"),
        ("[comm]\noutbox_limit_mb = 0", "comm.outbox_limit_mb must be between 1 and"),
        ("[wheels]\ntrack_m = -1", "wheels.track_m must be between"),
        ('[bridge]\nserial_port = "a\\u0000b"', "bridge.serial_port must be one line of at most 1000 characters"),
        (f'[mesh]\nkeys = "{"x" * 2000}"', "mesh.keys must be one line of at most 1000 characters"),
        ('[mesh]\nrouter = "udp"', 'mesh.router must be "tcp/HOST:PORT"'),
        (f'[visualizer]\nhost = "{"x" * 64}"', "visualizer.host must be a name or an address"),
        ('[poi]\nnumber_pattern = "([0-9]"', "poi.number_pattern is no regular expression: missing )"),
        ('[poi]\nnumber_pattern = "a{99999999999}"', "poi.number_pattern is no regular expression"),
        (f'[poi]\nnumber_pattern = "{"(" * 150}"', "poi.number_pattern is no regular expression"),
        ('[poi]\nnumber_pattern = "[[a]"', "poi.number_pattern is no regular expression: Possible nested set"),
        ('[poi]\nnumber_pattern = "[0-9]{2}–[0-9]{3}"', 'poi.number_pattern holds the dash "–", which is read as "-"'),
        ('[poi]\nnumber_pattern = "[0-9],[0-9]{2}"', "poi.number_pattern holds a comma, which goto takes for X,Y"),
        ('[poi]\nnumber_pattern = "[0-9]*"', "poi.number_pattern fits an empty text"),
        (
            '[poi]\nnumber_presets = ["building room"]',
            "poi.number_presets names 'building room'; the presets are plain",
        ),
        ('[poi]\nnumber_repairs = ["O0"]', "must be like"),
        (f'[poi]\nnumber_pattern = "{"a" * 201}"', "must be a regular expression of at most 200 characters"),
        ('[poi]\ndoor_colours = ["brown"]', "poi.door_colours[0] must be like 'H8-22 S60-255 V30-230', not 'brown'"),
        ("[wheels]\ntrack_m = 2026-01-01", "wheels.track_m must be a number"),
    ],
)
def test_a_mistake_is_named_in_one_sentence(text: str, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_config(text, "r.toml")
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_every_number_of_the_configuration_has_limits() -> None:
    for section in get_type_hints(Config).values():
        for name, hint in get_type_hints(section, include_extras=True).items():
            if "float" in str(hint) or "int" in str(hint):
                assert "Between(low=" in str(hint), f"{section.__name__}.{name}"


def test_a_pipe_is_no_configuration(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "robot.toml")
    with pytest.raises(ConfigError, match=r"robot\.toml cannot be read: it is no file"):
        load_config(tmp_path / "robot.toml")


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.toml cannot be read"):
        load_config(tmp_path / "nowhere.toml")


@given(st.text(st.characters(min_codepoint=32, max_codepoint=126)), st.integers(1, 10**6))
def test_written_text_reads_back_to_the_same_values(port: str, baud: int) -> None:
    config = Config(robot=RobotSection("r2"), bridge=BridgeSection(port, baud))
    assert parse_config(config_text(config)) == config
