#!/usr/bin/env bash
# Measures the node's latency from an image's last packet to its odometry, alternating with OpenCV's time for 1000 ORB keypoints:
# latency.sh FOLDER UNIT.py PEER [rel]; environment as for track.sh
set -u
here=$(cd "$(dirname "$0")" && pwd)
for _ in 1 2 3; do
  uptime | sed 's/.*load/load/'
  "$PY" "$2" "$1/rgb"
  "$here/track.sh" "$1" "$3" ${4:+rel}
done
"$PY" "$2" "$1/rgb"
