#!/usr/bin/env bash
# The whole robot on this machine, in the simulated building: sets up what is missing, then `indoor-mapping local`.
#   ./deploy/local.sh [--setup-only] [arguments of `indoor-mapping local`]
set -euo pipefail
# shellcheck source=deploy/setup.sh
source "$(dirname "${BASH_SOURCE[0]}")/setup.sh"
set_up
if [ "${1:-}" = "--setup-only" ]; then
    exit 0
fi
exec "$PYTHON" -m deploy local "$@"
