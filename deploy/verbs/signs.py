"""Verb `read-signs`: the POI module's reader on photos, without a robot."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from common.config import load_config
from common.errors import StartError, sentence


def add_verbs(verbs: Any) -> None:
    read = verbs.add_parser("read-signs", help="number plates in photos, one JSON line each")
    read.add_argument("photos", metavar="IMAGE_OR_FOLDER", type=Path, nargs="+")
    read.add_argument("--config", type=Path, help="robot.toml with the site's number format and room types")
    read.set_defaults(run=_read_signs)


def _read_signs(arguments: argparse.Namespace) -> int:
    """Exit code 2 when a photo could not be read; the others are read all the same."""
    from onboard.poi.camera.frame_source import photo_files  # here, because they load OpenCV
    from onboard.poi.signs.photo_reading import PhotoReader

    section = load_config(arguments.config).poi
    files = [file for path in arguments.photos for file in photo_files(path)]
    reader = PhotoReader(section)
    code = 0
    for file in files:
        try:
            findings = reader.findings(file)
        except (StartError, OSError) as error:
            sys.stderr.write(f"indoor-mapping: {sentence(error)}\n")
            code = 2
            continue
        for finding in findings:
            print(json.dumps(finding, ensure_ascii=False), flush=True)
    return code
