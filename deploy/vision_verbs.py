"""Verbs `read-signs` and `calibrate doors|camera`: the POI module's eyes on photos, without a robot."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from common.config import Config, load_config
from deploy.config_file import write_config

_CORNERS = range(3, 31)  # of a side of the chessboard: what OpenCV finds


def add_verbs(verbs: Any) -> None:
    read = verbs.add_parser("read-signs", help="number plates in photos, one JSON line each")
    read.add_argument("photos", metavar="IMAGE_OR_FOLDER", type=Path, nargs="+")
    read.add_argument("--config", type=Path, help="robot.toml with the site's number format and room types")
    read.set_defaults(run=_read_signs)


def add_calibrations(things: Any) -> None:
    doors = things.add_parser("doors", help="the colour of doors, from a photo whose middle a door fills")
    doors.add_argument("photo", metavar="PHOTO", type=Path)
    doors.set_defaults(run=_calibrate_doors)
    camera = things.add_parser("camera", help="the field of view, from photos of a chessboard")
    camera.add_argument("photos", metavar="PHOTO", type=Path, nargs="+")
    camera.add_argument("--columns", type=int, default=9, choices=_CORNERS, metavar="N", help="inner corners along (9)")
    camera.add_argument("--rows", type=int, default=6, choices=_CORNERS, metavar="N", help="inner corners across (6)")
    camera.set_defaults(run=_calibrate_camera)
    for parser in (doors, camera):
        parser.add_argument("--config", type=Path, default=Path("robot.toml"), help="the file to write (robot.toml)")


def _read_signs(arguments: argparse.Namespace) -> int:
    from onboard.poi.photo_reading import findings  # here, because it loads OpenCV

    for finding in findings(arguments.photos, load_config(arguments.config).poi):
        print(json.dumps(finding, ensure_ascii=False), flush=True)
    return 0


def _calibrate_doors(arguments: argparse.Namespace) -> int:
    from onboard.poi.calibration import door_colour
    from onboard.poi.frame_source import read_photo

    config = _config_to_write(arguments.config)
    box = str(door_colour(read_photo(arguments.photo)))
    colours = tuple(dict.fromkeys((*config.poi.door_colours, box)))
    write_config(arguments.config, replace(config, poi=replace(config.poi, door_colours=colours)))
    print(f"Doors are {box}, written to {arguments.config}. Repeat with a photo of every other colour of doors.")
    return 0


def _calibrate_camera(arguments: argparse.Namespace) -> int:
    from onboard.poi.calibration import field_of_view_deg
    from onboard.poi.frame_source import read_photo

    config = _config_to_write(arguments.config)
    photos = [read_photo(file) for file in arguments.photos]
    view_deg, error_px = field_of_view_deg(photos, arguments.columns, arguments.rows)
    write_config(arguments.config, replace(config, poi=replace(config.poi, field_of_view_deg=round(view_deg, 2))))
    print(f"The camera sees {view_deg:.2f} degrees (error {error_px:.2f} px), written to {arguments.config}.")
    return 0


def _config_to_write(file: Path) -> Config:
    return load_config(file if file.exists() else None)
