#!/usr/bin/env bash
# rosbags 0.11.9 (PyPI, the newest): big-endian arrays are stored as garbage, without an error.
#
# Expected: a field `float32[]` takes any numpy array of 4-byte floats and stores its values, or raises as it does for
# float64 ("different structures").
# Seen: an array of dtype '>f4', equal to its native twin in numpy's eyes, is written byte by byte as it lies in memory
# and comes back as 4.6e-41.
# Means: ranges out of big-endian sources (network order of sensors, FITS, 16-bit PGM) become
# bags that are valid and seem full of zeros. Convert with `array.astype(array.dtype.newbyteorder("="))` before.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'rosbags==0.11.9' 'numpy==2.4.6'
"$dir/venv/bin/python" - <<'EOF'
import numpy as np
from rosbags.typesys import Stores, get_typestore

store = get_typestore(Stores.ROS2_JAZZY)
Scan, Header, Time = (
    store.types[name] for name in ("sensor_msgs/msg/LaserScan", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
)


def stored(ranges):
    none = np.array([], np.float32)
    scan = Scan(Header(Time(0, 0), "sonar"), -1.0, 1.0, 1.0, 0.0, 0.1, 0.15, 6.45, ranges, none)
    return store.deserialize_cdr(store.serialize_cdr(scan, Scan.__msgtype__), Scan.__msgtype__).ranges


native = np.array([1, 2, 3], "<f4")
swapped = native.astype(">f4")
assert (native == swapped).all()
print("native    ", stored(native))
print("big-endian", stored(swapped))
assert (stored(native) == native).all()
assert stored(swapped).tolist() == native.byteswap().tolist(), "changed"
EOF
