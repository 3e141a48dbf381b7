#!/usr/bin/env bash
# pyogrio 0.13.0 with geopandas 1.2.0 and GDAL 3.12 (PyPI, the newest): room numbers in quotes come back as numbers.
#
# Expected: a GeoJSON property "1.10" is a string in the file, so `read_file` gives the string '1.10'.
# Seen: it does, unless a single feature of the file has a bare number there (205 instead of "205"). GDAL then marks
# the field as JSON, forgets which values had quotes, and pyogrio decodes each: '1.10' and '1.1' are both 1.1, '1e3' is
# 1000.0. If one value of the file is no JSON ('12b'), all stay strings, with a warning.
# Means: floors and rooms of indoor maps merge or change their names, depending on features elsewhere in the file; one
# floor's file is read right and the building's is not. Write such properties so that none is valid JSON, or read them
# with the json module.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'pyogrio==0.13.0' 'geopandas==1.2.0'
cd "$dir"
venv/bin/python -W ignore - <<'EOF'
import json

import geopandas


def read_back(refs):
    features = [{"type": "Feature", "properties": {"ref": ref}, "geometry": {"type": "Point", "coordinates": [0, 0]}}
                for ref in refs]
    with open("rooms.geojson", "w") as file:
        json.dump({"type": "FeatureCollection", "features": features}, file)
    return geopandas.read_file("rooms.geojson")["ref"].tolist()


ROOMS = ["1.10", "1.1", "1e3"]
seen = {name: read_back(refs) for name, refs in {
    "strings only": ROOMS, "and the number 205": [*ROOMS, 205], "and 205 and '12b'": [*ROOMS, 205, "12b"]}.items()}
for name, refs in seen.items():
    print(f"{name}: {refs}")
assert list(seen.values()) == [ROOMS, [1.1, 1.1, 1000.0, 205.0], [*ROOMS, "205", "12b"]], "changed"
EOF
