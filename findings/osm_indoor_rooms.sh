#!/usr/bin/env bash
# GDAL 3.12 (in pyogrio 0.13.0, PyPI, the newest): rooms of one floor of an OSM file land in two layers, as two types.
#
# Expected: OpenStreetMap's Simple Indoor Tagging maps rooms, corridors and areas as closed ways with indoor=*; read by
# GDAL, QGIS or geopandas, all of a floor's rooms are polygons in the layer `multipolygons`.
# Seen: an office and a corridor are LineStrings in `lines`, without area; the toilet beside them is a polygon, because
# it happens to have amenity=* too. The driver's list of keys that make a closed way an area (osmconf.ini) lacks indoor.
# Means: area sums, point-in-room queries and maps silently miss most rooms, yet show some, so that it looks like
# incomplete data. Add `indoor` to closed_ways_are_polygons in an osmconf.ini of your own (CONFIG_FILE, also shown here)
# and expect indoor=wall to become an area then.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'pyogrio==0.13.0' 'numpy==2.4.6'
cd "$dir"
venv/bin/python - <<'EOF'
from pathlib import Path

import pyogrio

CORNERS = ((0, 0), (0, 1), (1, 1), (1, 0))
ROOMS = {"office": {"indoor": "room"}, "hall": {"indoor": "corridor"},
         "toilet": {"indoor": "room", "amenity": "toilets"}}
nodes = "".join(f'<node id="{i}" lat="{50 + y / 1e4}" lon="{8 + x / 1e4}"/>' for i, (x, y) in enumerate(CORNERS, 1))
ways = ""
for number, (name, tags) in enumerate(ROOMS.items(), 1):
    pairs = {"name": name, "level": "2", **tags}.items()
    ways += f'<way id="{number}">' + "".join(f'<nd ref="{i}"/>' for i in (1, 2, 3, 4, 1))
    ways += "".join(f'<tag k="{key}" v="{value}"/>' for key, value in pairs) + "</way>"
Path("floor.osm").write_text(f'<osm version="0.6">{nodes}{ways}</osm>')
Path("indoor.ini").write_text(
    "closed_ways_are_polygons=amenity,building,indoor\n[lines]\nosm_id=yes\nattributes=name\n"
    "[multipolygons]\nosm_id=yes\nattributes=name\n"
)


def layers(**options):
    return {layer: sorted(pyogrio.raw.read("floor.osm", layer=layer, columns=["name"], **options)[3][0])
            for layer in ("lines", "multipolygons")}


print("GDAL", pyogrio.__gdal_version_string__)
print("as it comes:        ", layers())
print("with indoor as area:", layers(CONFIG_FILE="indoor.ini"))
assert layers() == {"lines": ["hall", "office"], "multipolygons": ["toilet"]}, "changed"
assert layers(CONFIG_FILE="indoor.ini") == {"lines": [], "multipolygons": sorted(ROOMS)}, "changed"
EOF
