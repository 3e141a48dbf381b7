"""`indoor-mapping VERB`: finds the verb and turns what a person did wrong into one sentence and exit code 2."""

from __future__ import annotations

import argparse
import importlib
import io
import os
import re
import signal
import sys
import threading
from collections.abc import Callable, Iterable
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

from common.environment import PROCESS_ENVIRONMENT
from common.errors import StartError, sentence
from deploy import INTERRUPTED

# Module of `deploy.verbs` -> its verbs. Only the module of the verb that is given is loaded: a stop must not wait until
# the mapping unit, the simulator and their libraries are
FAMILIES = {
    "simulation": ("local", "simulate", "floors"),
    "replay": ("replay",),
    "node": ("node", "command-center"),
    "stop": ("estop",),
    "operator": ("release", "start", "pause", "resume", "home", "goto", "pose"),
    "zones": ("zone",),
    "doors": ("door",),
    "records": ("runs", "export"),
    "view": ("view",),
    "signs": ("read-signs",),
    "service": ("check-sensors", "drive", "calibrate"),
    "deployment": ("deploy",),
    "bench": ("bench",),
}


_NUMBERS = re.compile(r"-[\d.]+,")


class _Parser(argparse.ArgumentParser):
    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.register("type", Path, _path)

    def error(self, message: str) -> NoReturn:
        sys.stderr.write(f"{self.prog}: {message}; see {self.prog} --help\n")
        sys.exit(2)


def _path(text: str) -> Path:
    """An empty name, of a shell variable that is not set for example, would be the folder that one is in."""
    if not text.strip():
        raise argparse.ArgumentTypeError("must name a file or folder, and is empty")
    return Path(text)


def build_parser(families: Iterable[str] = tuple(FAMILIES)) -> argparse.ArgumentParser:
    """Every verb sets `run`, a function of the parsed arguments that returns the exit code."""
    parser = _Parser(prog="indoor-mapping", description="A robot that explores a floor on its own and maps it.")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True, parser_class=_Parser)
    for family in families:
        importlib.import_module(f"deploy.verbs.{family}").add_verbs(verbs)
    return parser


def families_of(words: list[str]) -> tuple[str, ...]:
    """The family whose verb comes first among the words; all where there is none, for help and complaints."""
    return tuple(family for family, verbs in FAMILIES.items() if words and words[0] in verbs) or tuple(FAMILIES)


def no_options(words: Iterable[str]) -> list[str]:
    """Words such as -3,1 are numbers: with a blank before them nothing takes them for an option."""
    return [f" {word}" if _NUMBERS.match(word) else word for word in words]


def _interrupt(ends: Callable[[int, FrameType | None], Any]) -> None:
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, ends)


def main(argv: list[str] | None = None) -> int:
    words = no_options(sys.argv[1:] if argv is None else argv)
    for name, value in PROCESS_ENVIRONMENT.items():  # before any library is loaded
        os.environ.setdefault(name, value)
    # While libraries are loaded it ends the program: it could come out of any of them as any error
    _interrupt(lambda *_: os._exit(INTERRUPTED))
    try:
        arguments = build_parser(families_of(words)).parse_args(words)
    finally:
        _interrupt(signal.default_int_handler)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # for characters that the terminal lacks
    try:
        code: int = arguments.run(arguments)
    except (StartError, OSError) as error:
        sys.stderr.write(f"indoor-mapping: {sentence(error)}\n")
        return 2
    except KeyboardInterrupt:
        return INTERRUPTED
    return code


if __name__ == "__main__":
    sys.exit(main())
