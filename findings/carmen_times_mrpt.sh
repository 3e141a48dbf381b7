#!/usr/bin/env bash
# mrpt-apps 2.5.8 (Debian 12, the newest there): `carmen2rawlog` gives all scans of a CARMEN log the same time.
# The line at fault is the same in the sources of July 2026.
#
# Expected: scans that a log stamps 10 s apart are 10 s apart in the rawlog, whatever its first moment is set to.
# Seen: 4 scans over 30 s all have the moment of the conversion, to the microsecond; `rawlog-edit --info` tells of a
# duration of 0.000 s and a rate of "inf". The seconds of the log are multiplied by 1e-6 where 1e6 is meant, then cut to
# whole microseconds. Of the ground-truth file that is written beside, only one pose of four is left.
# Means: the public logs that this field is measured with (Intel, MIT, Freiburg: all CARMEN) lose their time when they
# are converted. Whatever goes by time (speeds, process noise, pairing with a reference trajectory) is wrong, while the
# picture of the map looks right. Take the time from the log itself.
set -euo pipefail
command -v carmen2rawlog >/dev/null ||
  { apt-get update -qq && apt-get install -y -qq --no-install-recommends mrpt-apps; }
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
awk 'BEGIN {
  for (k = 0; k < 4; k++) {
    printf "FLASER 180"
    for (i = 0; i < 180; i++) printf " 2.00"
    printf " %d 0 0 %d 0 0 %.6f robot %.6f\n", k, k, 1000000000 + 10 * k, 10 * k
  }
}' >robot.log
awk '{print "in the log: x " $(NF - 5) " m at " $(NF - 2) " s"}' robot.log
carmen2rawlog -i robot.log -o robot.rawlog >/dev/null
rawlog-edit -i robot.rawlog --export-odometry-txt >/dev/null
awk 'NR > 1 {print "in the rawlog: x " $2 " m at " $1 " s"}' robot_ODOMETRY.txt
times=$(awk 'NR > 1 {print $1}' robot_ODOMETRY.txt | sort -u | wc -l)
poses=$(grep -vc '^%' robot.gt.txt)
echo "different times: $times of 4, poses in the ground truth: $poses of 4"
[ "$times $poses" = "1 1" ] || { echo "changed"; exit 1; }
