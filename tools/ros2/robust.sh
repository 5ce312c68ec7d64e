#!/usr/bin/env bash
# Plays a camera that stops and returns as another process, sets its clock back, sends unsupported images, and has no calibration.
# usage: robust.sh FOLDER; environment as for track.sh
set -u
here=$(cd "$(dirname "$0")" && pwd)
# shellcheck source=loopback.sh
. "$here/loopback.sh"
out=$WORK/robust
rm -rf "$out" && mkdir -p "$out"
play() {
  echo "== $1"
  shift
  "$PY" "$here/play.py" "$@"
}
"$NODE" --ros-args -p frames:=all >"$out/node.txt" 2>&1 &
node=$!
play "at first" "$1" "$out/1.json" --frames 60
sleep 3
play "after 3 s, with new ids" "$1" "$out/2.json" --frames 60 --shift 10
play "its clock was set back" "$1" "$out/3.json" --frames 60 --shift -1000
play "what is not read" "$1" "$out/4.json" --frames 30 --shift 100 --encoding h264
play "what is read again" "$1" "$out/5.json" --frames 60 --shift 200
kill -INT $node
wait $node
"$NODE" --ros-args -p frames:=all >"$out/node2.txt" 2>&1 &
node=$!
play "no camera info" "$1" "$out/6.json" --frames 60 --no-info
play "with camera info" "$1" "$out/7.json" --frames 60 --shift 10
kill -INT $node
wait $node
cat "$out/node.txt" "$out/node2.txt"
