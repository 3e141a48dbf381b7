"""Files and folders that are there whole or not at all, for libraries that write by themselves."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Gives the name to write to, of a file or folder; it becomes `path`, in place of an older one, at the end.

    What ends with an error leaves the old one; what a kill leaves is gone the next time.
    """
    folder = path.with_name(f".{path.name}.part")
    _remove(folder)
    folder.mkdir()
    part = folder / path.name  # libraries name files after the folder that they write
    try:
        yield part
        _sync(part)
        if part.is_dir():
            _remove(path)
        part.replace(path)
    finally:
        _remove(folder)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _sync(path: Path) -> None:
    for file in path.iterdir() if path.is_dir() else (path,):
        descriptor = os.open(file, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
