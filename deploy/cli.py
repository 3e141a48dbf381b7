"""`indoor-mapping VERB`: finds the verb and turns what a person did wrong into one sentence and exit code 2."""

from __future__ import annotations

import argparse
import importlib
import io
import os
import sys
from collections.abc import Iterable
from typing import NoReturn

from common.environment import PROCESS_ENVIRONMENT
from common.errors import StartError, sentence

# Module of `deploy.verbs` -> its verbs. Only the module of the verb that is given is loaded: a stop must not wait until
# the mapping unit, the simulator and their libraries are
FAMILIES = {
    "simulation": ("local", "simulate", "floors"),
    "replay": ("replay",),
    "node": ("node", "command-center"),
    "operator": ("estop", "release", "start", "pause", "resume", "home", "goto"),
    "records": ("runs", "export"),
    "signs": ("read-signs",),
    "service": ("check-sensors", "drive", "calibrate"),
    "deployment": ("deploy",),
    "bench": ("bench",),
}


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        sys.stderr.write(f"{self.prog}: {message}; see {self.prog} --help\n")
        sys.exit(2)


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


def main(argv: list[str] | None = None) -> int:
    words = sys.argv[1:] if argv is None else argv
    for name, value in PROCESS_ENVIRONMENT.items():  # before any library is loaded
        os.environ.setdefault(name, value)
    arguments = build_parser(families_of(words)).parse_args(words)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # for characters that the terminal lacks
    try:
        code: int = arguments.run(arguments)
    except (StartError, OSError) as error:
        sys.stderr.write(f"indoor-mapping: {sentence(error)}\n")
        return 2
    return code


if __name__ == "__main__":
    sys.exit(main())
