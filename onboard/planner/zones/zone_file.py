"""The zones on disk: they outlive every restart, as the map does that they were drawn on."""

from __future__ import annotations

import json
import logging
from pathlib import Path

from common.zones import Zone, of_json

ZONES_NAME = "zones.json"  # in the log folder of the planner

_log = logging.getLogger("planner")


def read_zones(file: Path) -> tuple[Zone, ...] | None:
    """None for a file that is damaged: nobody knows what it forbade. No file: no zones. Raises OSError."""
    try:
        return of_json(json.loads(file.read_text(encoding="utf-8")))
    except FileNotFoundError:
        return ()
    except (ValueError, RecursionError) as error:
        _log.error("zones not readable file=%s error=%s", file, error)
        return None
