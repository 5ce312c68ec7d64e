#!/usr/bin/env bash
# Runs the node with a detector: detector.sh FOLDER MODEL; environment as for track.sh
set -u
here=$(cd "$(dirname "$0")" && pwd)
# shellcheck source=loopback.sh
. "$here/loopback.sh"
out=$WORK/detector
rm -rf "$out" && mkdir -p "$out"
"$NODE" --ros-args -p model:="$2" -p record:="$out/run.mcap" -p log:="$out/run.log" >"$out/node.txt" 2>&1 &
node=$!
"$PY" "$here/play.py" "$1" "$out/heard.json" --objects
kill -INT $node
wait $node
grep -a 'ended\|WARN\|ERROR\|detector' "$out/node.txt" | cut -c1-200
"$STILLPOINT" replay "$out/run.log" "$out/run.mcap" --out "$out/replay" --no-report 2>&1 | grep -a 'bit for bit\|expected'
"$STILLPOINT" eval "$1/groundtruth.txt" "$out/replay/trajectory.txt" 2>&1 | grep ATE
rm -f "$out/run.mcap"
