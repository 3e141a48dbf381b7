#!/usr/bin/env bash
# GDAL 3.12 (in pyogrio 0.13.0, PyPI, the newest): GeoJSON whose `crs` is not known is taken for degrees.
#
# Expected: a file that names its coordinate system, by a code that this GDAL lacks or a name of its own, has an unknown
# coordinate system, or reading it warns.
# Seen: it has EPSG:4326, as if the member were not there, with nothing in the log. A local system as WKT is understood.
# Means: floor plans in metres of the building, which say so, land in the Gulf of Guinea and are measured in degrees:
# areas and distances come out of a sphere. Write the system as LOCAL_CS (WKT), or set it after reading.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'pyogrio==0.13.0' 'numpy==2.4.6'
cd "$dir"
venv/bin/python - <<'EOF'
import json
import logging

import pyogrio

logging.basicConfig(level=logging.INFO)
NAMES = ("urn:ogc:def:crs:EPSG::25832", "urn:ogc:def:crs:EPSG::999999", "metres of building 5",
         'LOCAL_CS["building 5",UNIT["metre",1.0]]')
seen = []
for name in NAMES:
    door = {"type": "Feature", "properties": {}, "geometry": {"type": "Point", "coordinates": [12.5, 700.0]}}
    crs = {"type": "name", "properties": {"name": name}}
    with open("doors.geojson", "w") as file:
        json.dump({"type": "FeatureCollection", "crs": crs, "features": [door]}, file)
    seen.append(pyogrio.read_info("doors.geojson")["crs"])
    print(f"{name}: {seen[-1]}")
assert seen[:3] == ["EPSG:25832", "EPSG:4326", "EPSG:4326"] and seen[3].startswith("LOCAL_CS"), "changed"
EOF
