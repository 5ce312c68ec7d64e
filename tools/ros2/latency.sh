#!/usr/bin/env bash
# From an image's last packet to its odometry inside the node, beside the time that OpenCV takes for 1000 keypoints of ORB, in turn: latency.sh FOLDER UNIT.py PEER [rel]
# environment as of track.sh
set -u
here=$(cd "$(dirname "$0")" && pwd)
for _ in 1 2 3; do
  uptime | sed 's/.*load/load/'
  "$PY" "$2" "$1/rgb"
  "$here/track.sh" "$1" "$3" ${4:+rel}
done
"$PY" "$2" "$1/rgb"
