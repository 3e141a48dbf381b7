"""What a cell of the occupancy grid holds (`GridUpdate`), in one place for who makes, reads and shows it."""

from __future__ import annotations

import zlib

import numpy as np
import numpy.typing as npt

from common.messages.mapping import GridUpdate

UNKNOWN, FREE, WALL = 0, 1, 2


def cells_of(update: GridUpdate) -> npt.NDArray[np.uint8]:
    """Its cells (rows, columns), row 0 at the lowest y; a few bytes may claim to be gigabytes, so no more are unpacked.

    Raises ValueError when they cannot be unpacked or do not fill the announced shape.
    """
    count = update.rows * update.columns
    inflater = zlib.decompressobj()
    try:
        cells = inflater.decompress(update.cells_zlib, max(count, 1))
        more = b"" if inflater.eof else inflater.decompress(inflater.unconsumed_tail, 1)
    except zlib.error as error:
        raise ValueError(str(error)) from error
    if len(cells) != count or more or not inflater.eof:
        raise ValueError(f"not the {count} cells of its rows and columns")
    return np.frombuffer(cells, np.uint8).reshape(update.rows, update.columns)
