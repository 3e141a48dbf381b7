#!/usr/bin/env bash
# ezdxf 1.4.5 (PyPI, the newest): a wall of 3.2 m is dimensioned as 320, in a drawing of millimetres as 320000.
#
# Expected: in a drawing whose units were given (`units=`), a linear dimension shows the measured length in these.
# Seen: the dimension style that every dimension has by default, EZDXF, multiplies by 100 whatever the units are: it
# is meant for drawings in metres that are dimensioned in centimetres, and writes no unit.
# Means: a plan in millimetres has walls of 320000, one in metres has 320 where the drawing's own unit says 3.20; who
# measures on the plan finds both right, since only the text is. Give dimstyle="Standard" (shown too), or set
# override={"dimlfac": 1}.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'ezdxf==1.4.5'
"$dir/venv/bin/python" - <<'EOF'
import ezdxf
from ezdxf import units


def dimension(length, unit, **style):
    document = ezdxf.new("R2018", setup=True, units=unit)
    space = document.modelspace()
    made = space.add_linear_dim(base=(0, length / 3), p1=(0, 0), p2=(length, 0), **style).render()
    block = document.blocks.get(made.dimension.dxf.geometry)
    return [entity.text if entity.dxftype() == "MTEXT" else entity.dxf.text for entity in block.query("TEXT MTEXT")]


seen = {"3.2 in metres": dimension(3.2, units.M), "3200 in millimetres": dimension(3200.0, units.MM),
        "3.2 in metres, Standard": dimension(3.2, units.M, dimstyle="Standard")}
for what, text in seen.items():
    print(f"{what}: {text}")
assert list(seen.values()) == [["320"], ["320000"], ["3,2"]], "changed"
EOF
