#!/usr/bin/env bash
# GDAL 3.12 (in pyogrio 0.13.0, PyPI, the newest): the sheet's frame lies among the walls of a DXF drawing.
#
# Expected: a DXF file has the building in model space and the printed sheet (frame, title block) in paper space, two
# worlds with units and origins of their own; a reader gives the building, or two layers.
# Seen: one layer `entities` with both, each at its own coordinates: a hall of 10 m and a frame of 420 x 297, which
# are millimetres. Only the attribute PaperSpace of each entity tells; neither it nor the CRS has a unit ($INSUNITS is
# lost).
# Means: extent, length sums and maps of every drawing that has a layout are wrong by an order of magnitude, and a
# drawing without one is right. Filter with "PaperSpace IS NULL" (also shown).
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'pyogrio==0.13.0' 'numpy==2.4.6' 'ezdxf==1.4.5' 'shapely==2.2.0'
cd "$dir"
venv/bin/python - <<'EOF'
import ezdxf
import pyogrio
import shapely

drawing = ezdxf.new("R2004", units=ezdxf.units.M)
drawing.modelspace().add_lwpolyline([(0, 0), (10, 0), (10, 2), (0, 2)], close=True)
drawing.layout("Layout1").add_lwpolyline([(0, 0), (420, 0), (420, 297), (0, 297)], close=True)
drawing.saveas("hall.dxf")


def read(**options):
    lines = shapely.from_wkb(pyogrio.raw.read("hall.dxf", **options)[2])
    return shapely.total_bounds(lines).tolist(), float(sum(line.length for line in lines))


print("layers", pyogrio.list_layers("hall.dxf").tolist(), "crs", pyogrio.read_info("hall.dxf")["crs"])
seen = {"as it comes": read(), "PaperSpace IS NULL": read(where="PaperSpace IS NULL")}
for what, (bounds, length) in seen.items():
    print(f"{what}: extent {bounds}, length of all lines {length}")
assert seen["as it comes"] == ([0, 0, 420, 297], 24 + 1434), "changed"
assert seen["PaperSpace IS NULL"] == ([0, 0, 10, 2], 24), "changed"
EOF
