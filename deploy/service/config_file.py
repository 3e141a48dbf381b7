"""What `calibrate` has measured -> `robot.toml`."""

from __future__ import annotations

from pathlib import Path

from common.config import Config
from common.config_file import config_text, parse_config
from offboard.runs.run_folder import write_atomically


def write_config(file: Path, config: Config) -> None:
    """Replaces the file, or leaves it as it was: raises ConfigError for what no process could read back, OSError."""
    text = config_text(config)
    parse_config(text, str(file))
    write_atomically(file.resolve(), text.encode())
