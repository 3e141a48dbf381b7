"""`calibrate doors` and `calibrate camera`: the POI module's settings, measured from photos."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from common.config import Config
from common.config_file import load_config
from common.errors import StartError
from deploy.service.config_file import write_config
from onboard.poi.camera.calibration import field_of_view_deg
from onboard.poi.camera.frame_source import read_photo
from onboard.poi.doors.door_calibration import WALL_SHARE_MAX, calibrated_box, door_of, marked, wall_of


def calibrate_doors(arguments: argparse.Namespace) -> int:
    config = _config_to_write(arguments.config)
    photo = read_photo(arguments.photo)
    wall = wall_of(photo) if arguments.wall is None else read_photo(arguments.wall)
    box, share = calibrated_box(door_of(photo), wall)
    mask = arguments.photo.with_name(f"{arguments.photo.stem}-door.png")
    mask.write_bytes(marked(photo, box))
    if share > WALL_SHARE_MAX:
        raise StartError(
            f"The wall has the colour of the door: {box} holds {100 * share:.0f} % of it, {mask} shows bright what "
            "counts as door. Take the photo from where wall stands left and right of the door, or give one of the wall "
            "with --wall; doors in the wall's colour need no calibration."
        )
    colours = tuple(dict.fromkeys((*config.poi.door_colours, str(box))))
    write_config(arguments.config, replace(config, poi=replace(config.poi, door_colours=colours)))
    print(
        f"Doors are {box}, written to {arguments.config}; {mask} shows bright what counts as door. Repeat with a photo "
        "of every other colour of doors."
    )
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
