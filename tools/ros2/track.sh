#!/usr/bin/env bash
# Plays a folder in real time from another middleware's peer: frames with a pose, latency, replay, error.
#
# usage: track.sh FOLDER PEER [rel]; PEER is cyclone or fast.
# Environment: NODE, STILLPOINT (programs), PY (Python with cyclonedds, numpy, opencv), FAST (fast_peer), WORK (a scratch folder)
set -u
folder=$1 peer=$2 rel=${3:-}
here=$(cd "$(dirname "$0")" && pwd)
# shellcheck source=loopback.sh
. "$here/loopback.sh"
out=$WORK/$(basename "$folder")_$peer${rel:+_rel}
rm -rf "$out" && mkdir -p "$out"
"$NODE" --ros-args -p frames:=all -p record:="$out/run.mcap" -p log:="$out/run.log" ${rel:+-p reliability:=reliable} >"$out/node.txt" 2>&1 &
node=$!
sleep 1
if [ "$peer" = fast ]; then
  bin=$WORK/$(basename "$folder").bin
  [ -f "$bin" ] || "$PY" "$here/dump.py" "$folder" "$bin"
  "$FAST" "$bin" $rel
else
  "$PY" "$here/play.py" "$folder" "$out/heard.json" ${rel:+--reliable}
fi
kill -INT $node
wait $node
grep -a 'ended' "$out/node.txt" | sed 's/.*run 1/run 1/'
"$STILLPOINT" replay "$out/run.log" "$out/run.mcap" --out "$out/replay" --no-report 2>&1 | grep -a 'bit for bit\|expected'
"$STILLPOINT" eval "$folder/groundtruth.txt" "$out/replay/trajectory.txt" 2>&1 | grep ATE
rm -f "$out/run.mcap"
