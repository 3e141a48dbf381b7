"""Reading a text file, with one sentence as the error for anything that is none."""

from __future__ import annotations

from pathlib import Path


def read_text(file: Path, source: str, error_type: type[Exception], kind: str = "text") -> str:
    """What the file holds, as UTF-8; raises `error_type` with a sentence that begins with `source`.

    `kind` is what it should be. A pipe or device, which may never end, is no file.
    """
    try:
        if file.exists() and not file.is_file():
            raise error_type(f"{source} cannot be read: it is no file.")
        return file.read_text(encoding="utf-8")
    except OSError as error:
        raise error_type(f"{source} cannot be read: {error.strerror or error}.") from error
    except UnicodeDecodeError as error:
        raise error_type(f"{source} is not {kind}: its byte {error.start + 1} belongs to no text in UTF-8.") from error
