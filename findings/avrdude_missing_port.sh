#!/usr/bin/env bash
# avrdude 7.1 (Debian 12): with a port that is not there, `-c wiring` never ends.
#
# Expected: one line, and an exit code other than 0, as with `-c stk500v2`, the same protocol without a reset.
# Seen: it says that the port cannot be opened, goes on with it all the same, and polls what was never opened, at the
# cost of a whole core.
# Means: who flashes a Mega from a script looks for the port first, and limits the time.
set -euo pipefail
command -v avrdude >/dev/null || { apt-get update -qq && apt-get install -y -qq --no-install-recommends avrdude; } >&2
ended() {
    local code=0
    timeout 5 avrdude -q -c "$1" -p atmega2560 -P /dev/nowhere -b 115200 </dev/null >/dev/null 2>&1 || code=$?
    echo "$1: exit code $code (124: ended by timeout)" >&2
    echo "$code"
}
test "$(ended stk500v2)" = 1
test "$(ended wiring)" = 124
