"""`indoor-mapping VERB`: finds the verb and turns what a person did wrong into one sentence and exit code 2."""

from __future__ import annotations

import argparse
import sys
from typing import NoReturn

from common.errors import StartError
from common.plain_text import plain
from deploy import (
    bench_verb,
    board_verbs,
    calibrate_verb,
    deploy_verbs,
    node_verb,
    operator_verbs,
    record_verbs,
    replay_verb,
    run_verbs,
    vision_verbs,
)

SENTENCE_LENGTH_MAX = 2000  # of what was wrong: words of files and of the mesh may stand in it


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        sys.stderr.write(f"{self.prog}: {message}; see {self.prog} --help\n")
        sys.exit(2)


def build_parser() -> argparse.ArgumentParser:
    """Every verb sets `run`, a function of the parsed arguments that returns the exit code."""
    parser = _Parser(prog="indoor-mapping", description="A robot that explores a floor on its own and maps it.")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True, parser_class=_Parser)
    for family in (
        run_verbs,
        replay_verb,
        node_verb,
        operator_verbs,
        record_verbs,
        vision_verbs,
        board_verbs,
        calibrate_verb,
        deploy_verbs,
        bench_verb,
    ):
        family.add_verbs(verbs)
    return parser


def main(argv: list[str] | None = None) -> int:
    arguments = build_parser().parse_args(argv)
    try:
        code: int = arguments.run(arguments)
    except StartError as error:
        sys.stderr.write(f"indoor-mapping: {plain(str(error), SENTENCE_LENGTH_MAX)}\n")
        return 2
    return code


if __name__ == "__main__":
    sys.exit(main())
