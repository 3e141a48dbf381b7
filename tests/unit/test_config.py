"""robot.toml: every mistake is one sentence that names file and key."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.config import BridgeSection, Config, ConfigError, RobotSection, config_text, load_config, parse_config
from common.constants import SONAR_BEARINGS_RAD


def test_empty_file_gives_the_defaults() -> None:
    assert parse_config("") == Config()
    assert load_config(None) == Config()


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
    ],
)
def test_a_mistake_is_named_in_one_sentence(text: str, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_config(text, "r.toml")
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.toml cannot be read"):
        load_config(tmp_path / "nowhere.toml")


@given(st.text(st.characters(min_codepoint=32, max_codepoint=126)), st.integers(1, 10**6))
def test_written_text_reads_back_to_the_same_values(port: str, baud: int) -> None:
    config = Config(robot=RobotSection("r2"), bridge=BridgeSection(port, baud))
    assert parse_config(config_text(config)) == config
