#!/usr/bin/env bash
# Plays colour as JPEG and depth as PNG (compressed and compressedDepth) from Cyclone DDS: compressed.sh FOLDER; environment as for track.sh
set -u
here=$(cd "$(dirname "$0")" && pwd)
# shellcheck source=loopback.sh
. "$here/loopback.sh"
out=$WORK/compressed
rm -rf "$out" && mkdir -p "$out"
"$NODE" --ros-args -p frames:=all -p color_transport:=compressed -p depth_transport:=compressedDepth -p record:="$out/run.mcap" -p log:="$out/run.log" >"$out/node.txt" 2>&1 &
node=$!
"$PY" "$here/play.py" "$1" "$out/heard.json" --compressed
kill -INT $node
wait $node
grep -a 'ended\|WARN\|ERROR' "$out/node.txt" | cut -c1-200
"$STILLPOINT" replay "$out/run.log" "$out/run.mcap" --out "$out/replay" --no-report 2>&1 | grep -a 'bit for bit\|expected'
"$STILLPOINT" eval "$1/groundtruth.txt" "$out/replay/trajectory.txt" 2>&1 | grep ATE
