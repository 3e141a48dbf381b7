#!/usr/bin/env bash
# SQLite 3.54.1 (in apsw 3.54.1.0, PyPI, the newest): who opens a database read-only leaves two new files beside it.
#
# Expected: a connection that may only read leaves the folder as it found it; files of a connection go when it closes,
# as they do with one that may write.
# Seen: opened with SQLITE_OPEN_READONLY, read and closed, a database in WAL mode has a -wal and a -shm file for good.
# They vanish when somebody opens it for writing.
# Means: looking at a recording changes its folder: checksums and comparisons of archives differ, a copy of "the
# database" leaves files behind, and where the folder is somebody else's the files belong to the reader. For a file
# that nobody writes, immutable=1 leaves nothing (shown too).
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'apsw==3.54.1.0'
mkdir "$dir/run"
cd "$dir/run"
../venv/bin/python - <<'EOF'
import os

import apsw


def files_after(name, flags):
    database = apsw.Connection(name, flags=flags | apsw.SQLITE_OPEN_URI)
    database.execute("SELECT * FROM poses").fetchall()
    database.close()
    return sorted(os.listdir())


made = apsw.Connection("run.db")
made.execute("PRAGMA journal_mode = WAL; CREATE TABLE poses (t)").fetchall()
made.close()
seen = {
    "made": sorted(os.listdir()),
    "read as immutable": files_after("file:run.db?immutable=1", apsw.SQLITE_OPEN_READONLY),
    "read only": files_after("run.db", apsw.SQLITE_OPEN_READONLY),
    "opened for writing": files_after("run.db", apsw.SQLITE_OPEN_READWRITE),
}
print("SQLite", apsw.sqlite_lib_version())
for what, names in seen.items():
    print(f"{what}: {names}")
assert seen.pop("read only") == ["run.db", "run.db-shm", "run.db-wal"], "changed"
assert all(names == ["run.db"] for names in seen.values()), "changed"
EOF
