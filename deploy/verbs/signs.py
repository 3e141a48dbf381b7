"""Verb `read-signs`: the POI module's reader on photos, without a robot."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from common.config_file import load_config
from common.errors import StartError, sentence

if TYPE_CHECKING:
    from onboard.poi.signs.photo_findings import PhotoFinding
    from onboard.poi.signs.site_numbers import SiteNumbers


def add_verbs(verbs: Any) -> None:
    read = verbs.add_parser("read-signs", help="signs in photos of one site, one JSON line each")
    read.add_argument("photos", metavar="IMAGE_OR_FOLDER", type=Path, nargs="+")
    read.add_argument("--config", type=Path, help="robot.toml with the site's number forms and room types")
    read.add_argument(
        "--explain", metavar="DIR", type=Path, help="draws the judgement into a copy of every photo there"
    )
    read.set_defaults(run=_read_signs)


def _read_signs(arguments: argparse.Namespace) -> int:
    """Prints what is settled at once, and at the end what the site's other plates decide.

    Exit code 2 when a photo could not be read; the others are read all the same.
    """
    from onboard.poi.camera.frame_source import photo_files  # here, because they load OpenCV
    from onboard.poi.signs.photo_reading import PhotoReader

    section = load_config(arguments.config).poi
    files = [file for path in arguments.photos for file in photo_files(path)]
    reader = PhotoReader(section)
    found: dict[Path, list[PhotoFinding]] = {}
    code = 0
    for file in files:
        try:
            found[file] = reader.findings(file)
        except (StartError, OSError) as error:
            sys.stderr.write(f"indoor-mapping: {sentence(error)}\n")
            code = 2
            continue
        _print([finding for finding in found[file] if not finding.waits], reader.site)
    _print([finding for findings in found.values() for finding in findings if finding.waits], reader.site)
    if reader.site.proposed:
        sys.stderr.write(f"indoor-mapping: {reader.site.proposal}\n")
    if arguments.explain is not None:
        _explain(found, reader.site, arguments.explain)
    return code


def _print(findings: list[PhotoFinding], site: SiteNumbers) -> None:
    for finding in findings:
        print(json.dumps(finding.record(site), ensure_ascii=False), flush=True)


def _explain(found: dict[Path, list[PhotoFinding]], site: SiteNumbers, folder: Path) -> None:
    """Raises StartError when the folder cannot be written."""
    from onboard.poi.signs.photo_reading import write_explained

    try:
        folder.mkdir(parents=True, exist_ok=True)
        for i, (file, findings) in enumerate(found.items(), start=1):
            write_explained(file, findings, site, folder / f"{i:04d}_{file.stem}.jpg")
    except OSError as error:
        raise StartError(sentence(error)) from error
