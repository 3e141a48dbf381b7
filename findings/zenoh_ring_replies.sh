#!/usr/bin/env bash
# eclipse-zenoh 1.10.2 (PyPI, the newest): replies of a query in a RingChannel are gone once the query has ended.
#
# Expected: `RingChannel(n)` keeps the newest n elements until they are taken, as `FifoChannel(n)` keeps the oldest
# ones; five replies in a ring for ten are all there, whenever one looks.
# Seen: as soon as the last reply has arrived, the ring is taken away with all that it holds. Iteration gives nothing
# and raises nothing; `try_recv()` raises "The ringbuffer has been deleted". With a FifoChannel all five are there.
# An undisturbed loop that begins at once gets anything from none to all of them, which looks like a lossy network.
# Means: never use a RingChannel with `get`. "No reply" from it is no evidence that nobody answered. A subscriber with
# a ring likewise loses the newest samples when its session closes; take them out before.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'eclipse-zenoh==1.10.2'
"$dir/venv/bin/python" - <<'EOF'
import time

import zenoh
from zenoh.handlers import FifoChannel, RingChannel

config = zenoh.Config()
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("listen/endpoints", "[]")
counts = {}
with zenoh.open(config) as session:
    session.declare_queryable("door/*", lambda query: [query.reply(f"door/{i}", str(i)) for i in range(5)])
    for channel in (FifoChannel, RingChannel):
        replies = session.get("door/*", handler=channel(10))
        time.sleep(0.5)  # whoever has something else to do first
        counts[channel.__name__] = len(list(replies))
print("replies out of 5:", counts)
assert counts == {"FifoChannel": 5, "RingChannel": 0}, "changed"
EOF
