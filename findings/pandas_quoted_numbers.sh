#!/usr/bin/env bash
# pandas 3.1.1 (PyPI, the newest): quoting=QUOTE_NONNUMERIC makes no difference to `read_csv`: text in quotes becomes
# numbers.
#
# Expected: with csv.QUOTE_NONNUMERIC "1.10" in quotes is text and 1.10 without is a number; that is what the constant
# means in the module that it comes from, whose reader does so (shown too), and what `to_csv` writes with it.
# Seen: `read_csv` accepts the argument and infers numbers all the same: the rooms "1.10" and "1.1" are both 1.1,
# "1e3" is 1000.0. A table that `to_csv(quoting=QUOTE_NONNUMERIC)` wrote does not come back, by the same argument, as
# it was.
# Means: tables of rooms, serial numbers and post codes merge rows although writer and reader were both told what is
# text. Name the columns: dtype={"number": str}.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'pandas==3.1.1' 'numpy==2.4.6'
"$dir/venv/bin/python" - <<'EOF'
import csv
import io

import pandas

ROOMS = ["1.10", "1.1", "1e3"]
text = pandas.DataFrame({"number": ROOMS, "x_m": [1.5, 2.5, 3.5]}).to_csv(index=False, quoting=csv.QUOTE_NONNUMERIC)
print(text)
_, *rows = csv.reader(io.StringIO(text), quoting=csv.QUOTE_NONNUMERIC)
seen = pandas.read_csv(io.StringIO(text), quoting=csv.QUOTE_NONNUMERIC)["number"].tolist()
print("csv.reader:     ", [row[0] for row in rows])
print("pandas.read_csv:", seen)
assert [row[0] for row in rows] == ROOMS and seen == [1.1, 1.1, 1000.0], "changed"
EOF
