#!/usr/bin/env bash
# mujoco 4.0.0 (PyPI, the newest): whether `mj_multiRay` sees a wall beyond its cutoff depends on the wall's length.
#
# Expected: `cutoff` is the range of the simulated sensor ("geoms further than cutoff are ignored"): a wall 9.95 m ahead
# is not seen with a cutoff of 6.45 m.
# Seen: the cutoff is compared with a sphere around the whole geom, not with the ray's length. A wall of 2 m is
# ignored, one of 20 m at the same distance is returned with 9.95 m. A plane (floor, unbounded wall) is always returned.
# Means: a simulated sonar or lidar gets echoes far beyond its range, from long walls only, so tests with a few short
# boxes pass. Compare the returned distance with the range yourself; the cutoff only saves time.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'mujoco==4.0.0'
"$dir/venv/bin/python" - <<'EOF'
import mujoco
import numpy as np

CUTOFF_M = 6.45


def distance_m(geom):
    """Along +x from the origin; -1 where nothing is met."""
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{geom}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    geom_id, distance = np.zeros(1, np.int32), np.zeros(1)
    mujoco.mj_multiRay(
        model, data, np.zeros(3), np.array([1.0, 0, 0]), None, True, -1, geom_id, distance, None, 1, CUTOFF_M
    )
    return round(distance[0], 2)


walls = {f"wall of {length} m": f'<geom type="box" pos="10 0 0" size=".05 {length / 2} 1"/>' for length in (2, 6, 20)}
walls["plane"] = '<geom type="plane" pos="9.95 0 0" zaxis="-1 0 0" size="0 0 .1"/>'
seen = {name: distance_m(geom) for name, geom in walls.items()}
for name, metres in seen.items():
    print(f"{name} at 9.95 m, cutoff {CUTOFF_M} m: {metres}")
assert list(seen.values()) == [-1, -1, 9.95, 9.95], "changed"
EOF
