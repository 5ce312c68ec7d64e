#!/usr/bin/env bash
# Runs two nodes in two namespaces on one machine, each with its own camera, and checks that they stay separate in topics, transforms and services.
#
# usage: two_nodes.sh FOLDER OTHER_FOLDER; environment as for track.sh
set -u
here=$(cd "$(dirname "$0")" && pwd)
# shellcheck source=loopback.sh
. "$here/loopback.sh"
out=$WORK/two_nodes
rm -rf "$out" && mkdir -p "$out"
nodes=()
for robot in one two; do
  "$NODE" --ros-args -r __ns:=/$robot -r /tf:=tf -r /tf_static:=tf_static -p frames:=all \
    -p record:="$out/$robot.mcap" -p log:="$out/$robot.log" >"$out/$robot.txt" 2>&1 &
  nodes+=($!)
done
sleep 1
"$PY" "$here/play.py" "$1" "$out/one.json" --namespace /one --own-tf >"$out/play_one.txt" 2>&1 &
first=$!
"$PY" "$here/play.py" "$2" "$out/two.json" --namespace /two --own-tf --shift 5000 >"$out/play_two.txt" 2>&1
wait $first
# Resets one; the other continues its run.
"$PY" "$here/ask.py" --namespace /one reset
sleep 1
echo "runs that the reset of /one has ended: $(grep -ac 'run 1 ended' "$out/one.txt") of /one, $(grep -ac 'run 1 ended' "$out/two.txt") of /two"
kill -INT "${nodes[@]}"
wait
for robot in one two; do
  echo "== /$robot"
  cat "$out/play_$robot.txt"
  grep -a 'ended' "$out/$robot.txt" | sed 's/.*run/run/'
  "$STILLPOINT" replay "$out/$robot.log" "$out/$robot.mcap" --out "$out/replay_$robot" --no-report 2>&1 | grep -a 'bit for bit\|expected'
done
"$STILLPOINT" eval "$1/groundtruth.txt" "$out/replay_one/trajectory.txt" 2>&1 | grep ATE
"$PY" - "$out" <<'PY'
import json, sys
out = sys.argv[1]
heard = {robot: json.load(open(f"{out}/{robot}.json")) for robot in ("one", "two")}
stamps = {robot: {o[0] for o in h["odometry"]} | {t[0] for t in h["tf"]} for robot, h in heard.items()}
print("stamps that both cameras heard of (0: neither node speaks to the other's listeners):", len(stamps["one"] & stamps["two"]))
PY
rm -f "$out"/*.mcap
