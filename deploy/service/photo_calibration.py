"""`calibrate doors` and `calibrate camera`: the POI module's settings, measured from photos."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from common.config import Config, load_config
from deploy.service.config_file import write_config
from onboard.poi.camera.calibration import field_of_view_deg
from onboard.poi.camera.frame_source import read_photo
from onboard.poi.doors.door_detection import calibrated_box


def calibrate_doors(arguments: argparse.Namespace) -> int:
    config = _config_to_write(arguments.config)
    box = str(calibrated_box(read_photo(arguments.photo)))
    colours = tuple(dict.fromkeys((*config.poi.door_colours, box)))
    write_config(arguments.config, replace(config, poi=replace(config.poi, door_colours=colours)))
    print(f"Doors are {box}, written to {arguments.config}. Repeat with a photo of every other colour of doors.")
    return 0


def calibrate_camera(arguments: argparse.Namespace) -> int:
    config = _config_to_write(arguments.config)
    photos = [read_photo(file) for file in arguments.photos]
    view_deg, error_px = field_of_view_deg(photos, arguments.columns, arguments.rows)
    write_config(arguments.config, replace(config, poi=replace(config.poi, field_of_view_deg=round(view_deg, 2))))
    print(f"The camera sees {view_deg:.2f} degrees (error {error_px:.2f} px), written to {arguments.config}.")
    return 0


def _config_to_write(file: Path) -> Config:
    return load_config(file if file.exists() else None)
