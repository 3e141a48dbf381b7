#!/usr/bin/env bash
# opencv-python-headless 5.0.0.93 (PyPI, the newest): the same PGM image has other grey values as P5 than as P2.
#
# Expected: in a PGM the header's maxval is white. A map with maxval 100 (per cent of occupancy) reads the same whether
# its numbers are stored as bytes (P5) or as text (P2).
# Seen: `imread` scales text to 0..255 and leaves bytes as they are: white is 255 in P2 and 100 in P5, where Pillow says
# 255 for both. With 16 bits OpenCV scales neither.
# Means: occupancy maps that are not of maxval 255 change their meaning with the flavour of the file: by the rule
# of ROS's map_server (darker than 0.65 is a wall) all of a P5 map of maxval 15 that OpenCV reads is wall.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'opencv-python-headless==5.0.0.93' 'pillow==13.0.0'
cd "$dir"
venv/bin/python - <<'EOF'
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

seen = {}
for maxval in (15, 100, 255):
    grey = [0, maxval // 2, maxval]
    Path("binary.pgm").write_bytes(b"P5\n3 1\n%d\n" % maxval + bytes(grey))
    Path("text.pgm").write_text(f"P2\n3 1\n{maxval}\n{grey[0]} {grey[1]} {grey[2]}\n")
    names = ("binary.pgm", "text.pgm")
    seen[maxval] = [cv2.imread(name, cv2.IMREAD_UNCHANGED)[0].tolist() for name in names]
    print(f"maxval {maxval}: OpenCV P5 {seen[maxval][0]}, P2 {seen[maxval][1]}; Pillow",
          *(np.asarray(Image.open(name))[0].tolist() for name in names))
assert seen[100] == [[0, 50, 100], [0, 127, 255]] and seen[15][0] == [0, 7, 15], "changed"
assert seen[255][0] == seen[255][1], "changed"
EOF
