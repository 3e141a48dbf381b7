#!/usr/bin/env bash
# mcap 1.6.0 (PyPI, the newest): of a log whose writer was killed, the default reads nothing of what is there.
#
# Expected: MCAP is made to survive a crash: chunks before the cut are whole. `NonSeekingReader`, the reader for files
# without an index, gives them, then an error.
# Seen: with its default log_time_order=True it raises EndOfFile before the first message; with log_time_order=False
# it gives every message of the whole chunks and then the same error. Nothing in the error tells of that.
# Means: the recording of the crash, which is the one that somebody needs, seems empty. Read with log_time_order=False
# and keep what came before the exception.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'mcap==1.6.0'
cd "$dir"
venv/bin/python - <<'EOF'
import json

from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader
from mcap.writer import Writer

with open("run.mcap", "wb") as file:
    writer = Writer(file, chunk_size=16 * 1024)
    writer.start()
    schema = writer.register_schema("Pose", "jsonschema", b'{"type": "object"}')
    channel = writer.register_channel("/pose", "json", schema)
    for k in range(10_000):
        writer.add_message(channel, k, json.dumps({"x": k}).encode(), k)
    written = file.tell()  # no finish(): the writer was killed


def read(**options):
    count = 0
    try:
        with open("run.mcap", "rb") as file:
            for _ in NonSeekingReader(file).iter_messages(**options):
                count += 1
    except EndOfFile as error:
        return count, repr(error)
    return count, "no error"


seen = read(), read(log_time_order=False)
print("log_time_order=True (default):", seen[0])
print("log_time_order=False:         ", seen[1])
assert seen[0][0] == 0 and seen[1][0] > 9000, "changed"
EOF
