#!/usr/bin/env bash
# Every check of the project: format, lint, types, tests. Sets up what is missing first.
#   ./deploy/test.sh [--setup-only] [arguments of pytest]
set -euo pipefail
# shellcheck source=deploy/setup.sh
source "$(dirname "${BASH_SOURCE[0]}")/setup.sh"
set_up
set_up_tests
if [ "${1:-}" = "--setup-only" ]; then
    exit 0
fi
cd "$ROOT"
"$PYTHON" -m ruff check .
"$PYTHON" -m ruff format --check .
"$PYTHON" -m mypy
if [ "$#" -gt 0 ]; then
    exec "$PYTHON" -m pytest "$@"
fi
# Tests of real processes assert how soon things happen: those have the machine to themselves. The many small ones come
# last, so that all workers end at about the same time
"$PYTHON" -m pytest -n auto --dist loadfile --no-loadscope-reorder --ignore tests/system
exec "$PYTHON" -m pytest tests/system
