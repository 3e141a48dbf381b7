#!/usr/bin/env bash
# mujoco 4.0.0 (PyPI, the newest; drawn by EGL with Mesa): a 2d texture on a box is mirrored on two of its four sides.
#
# Expected: a picture on a box reads the same from whichever side one looks at it, as on a real sign.
# Seen: looked at from outside, upright, it reads correctly on +x and -y and is mirrored left to right on -x and +y.
# Means: door plates, posters and tags in a simulated building are legible on half of the walls. Text recognition and
# fiducials fail there for no reason that a camera model would explain. Turn the box so that +x or -y faces the viewer.
set -euo pipefail
for package in libegl1 libopengl0 libgl1-mesa-dri; do
  dpkg -s "$package" >/dev/null 2>&1 || { apt-get update -qq && apt-get install -y -qq "$package"; }
done
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'mujoco==4.0.0'
MUJOCO_GL=egl "$dir/venv/bin/python" - <<'EOF'
import mujoco

SIDES = {"+x": ("1 0 0", "0 1 0"), "-x": ("-1 0 0", "0 -1 0"), "+y": ("0 1 0", "-1 0 0"), "-y": ("0 -1 0", "1 0 0")}
cameras = "".join(f'<camera name="{n}" pos="{at}" xyaxes="{right} 0 0 1"/>' for n, (at, right) in SIDES.items())
model = mujoco.MjModel.from_xml_string(f"""
<mujoco>
  <visual><headlight ambient="1 1 1" diffuse="0 0 0"/></visual>
  <asset>
    <texture name="sign" type="2d" builtin="flat" width="64" height="64"/>
    <material name="sign" texture="sign"/>
  </asset>
  <worldbody><geom type="box" size=".3 .3 .3" material="sign"/>{cameras}</worldbody>
</mujoco>""")
picture = model.tex_data.reshape(64, 64, 3)
picture[:, :32], picture[:, 32:] = 30, 220  # the sign: dark on its left, light on its right
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
seen = {}
with mujoco.Renderer(model, 100, 100) as renderer:
    for name in SIDES:
        renderer.update_scene(data, name)
        row = renderer.render()[50, :, 0]
        seen[name] = "correct" if row[40] < row[60] else "mirrored"
print(seen)
assert seen == {"+x": "correct", "-x": "mirrored", "+y": "mirrored", "-y": "correct"}, "changed"
EOF
