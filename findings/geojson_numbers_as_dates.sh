#!/usr/bin/env bash
# pyogrio 0.13.0 with GDAL 3.12 (PyPI, the newest): room "1204-02-01" is a date, "1204-02-30" makes a file unreadable.
#
# Expected: a GeoJSON property in quotes is text: building 1204, floor 02, rooms 01 and 30.
# Seen: GDAL takes a field for dates when every value has the shape of one: "1204-02-01" becomes the first of
# February 1204. It counts 1 to 31 for each month, which pyogrio's dates do not: with room 30 the whole file is refused
# ("day is out of range for month"), also with datetime_as_string=True. One room "205A" more, and all are text again.
# Means: what rooms a floor has decides whether their numbers are dates, text, or an error that names no row. Read with
# DATE_AS_STRING="YES" (also shown), or write the numbers with a prefix.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'pyogrio==0.13.0' 'numpy==2.4.6'
cd "$dir"
venv/bin/python - <<'EOF'
import json

import pyogrio


def read_back(*refs, **options):
    point = {"type": "Point", "coordinates": [0, 0]}
    rooms = [{"type": "Feature", "properties": {"ref": ref}, "geometry": point} for ref in refs]
    with open("rooms.geojson", "w") as file:
        json.dump({"type": "FeatureCollection", "features": rooms}, file)
    try:
        return [str(ref) for ref in pyogrio.raw.read("rooms.geojson", **options)[3][0]], pyogrio.read_info(
            "rooms.geojson", **options)["dtypes"].tolist()
    except ValueError as error:
        return repr(error), None


A, B, C = "1204-02-01", "1204-02-30", "205A"
cases = {"01 and 12": read_back(A, "1204-02-12"), "01 and 30": read_back(A, B), "and 205A": read_back(A, B, C),
         "01 and 30, DATE_AS_STRING": read_back(A, B, DATE_AS_STRING="YES")}
for what, seen in cases.items():
    print(f"{what}: {seen}")
kinds = [kind for _, kind in cases.values()]
assert kinds == [["datetime64[D]"], None, ["object"], ["object"]], "changed"
EOF
