"""Verb `read-signs`: the POI module's reader on photos, without a robot."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from common.config import load_config


def add_verbs(verbs: Any) -> None:
    read = verbs.add_parser("read-signs", help="number plates in photos, one JSON line each")
    read.add_argument("photos", metavar="IMAGE_OR_FOLDER", type=Path, nargs="+")
    read.add_argument("--config", type=Path, help="robot.toml with the site's number format and room types")
    read.set_defaults(run=_read_signs)


def _read_signs(arguments: argparse.Namespace) -> int:
    from onboard.poi.photo_reading import findings  # here, because it loads OpenCV

    for finding in findings(arguments.photos, load_config(arguments.config).poi):
        print(json.dumps(finding, ensure_ascii=False), flush=True)
    return 0
