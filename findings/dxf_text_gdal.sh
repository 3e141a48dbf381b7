#!/usr/bin/env bash
# GDAL 3.12 (in pyogrio 0.13.0) on drawings of ezdxf 1.4.5 (PyPI, the newest): layer names of DXF R2007 and later are
# garbled, those of R2004 and earlier are right.
#
# Expected: from R2007 (AC1021) on a DXF file is UTF-8, whatever its header variable $DWGCODEPAGE says, which
# programs go on writing as ANSI_1252.
# Seen: GDAL obeys the variable in every version: the layer "WÄNDE" of an R2018 file is "WÃ\x84NDE".
# Means: the newer the format of the floor plan, the worse: filters by layer ("where Layer = 'WÄNDE'") find nothing and
# room names are wrong, with no warning. Set the configuration option DXF_ENCODING=UTF-8 for R2007 and later (also shown
# here), or save as R2004.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'pyogrio==0.13.0' 'numpy==2.4.6' 'ezdxf==1.4.5'
cd "$dir"
venv/bin/python - <<'EOF'
import ezdxf
import pyogrio


def layer_read(version, encoding=None):
    drawing = ezdxf.new(version)
    drawing.layers.add("WÄNDE")
    drawing.modelspace().add_line((0, 0), (10, 0), dxfattribs={"layer": "WÄNDE"})
    drawing.saveas("plan.dxf")
    pyogrio.set_gdal_config_options({"DXF_ENCODING": encoding})
    return pyogrio.raw.read("plan.dxf", columns=["Layer"])[3][0][0]


seen = {version: layer_read(version) for version in ("R2000", "R2004", "R2007", "R2013", "R2018")}
seen["R2018, DXF_ENCODING"] = layer_read("R2018", "UTF-8")
print("GDAL", pyogrio.__gdal_version_string__)
for version, name in seen.items():
    print(f"{version}: {name!r}")
garbled = "WÄNDE".encode().decode("latin-1")
assert list(seen.values()) == ["WÄNDE", "WÄNDE", garbled, garbled, garbled, "WÄNDE"], "changed"
EOF
