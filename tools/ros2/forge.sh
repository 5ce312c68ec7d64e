#!/usr/bin/env bash
# Sends forged packets of each kind of mutate.py while a camera plays, and checks that tracking continues afterwards.
#
# usage: forge.sh FOLDER PACKETS [KIND...]; needs root; environment as for track.sh
set -u
folder=$1 packets=$2
shift 2
[ $# -gt 0 ] || set -- mutated frag small_frag empty_frag heartbeat gap nackfrag wide_set participants
here=$(cd "$(dirname "$0")" && pwd)
# shellcheck source=loopback.sh
. "$here/loopback.sh"
out=$WORK/forge
rm -rf "$out" && mkdir -p "$out"
for kind in "$@"; do
  for rel in '' rel; do
    echo "== $kind, ${rel:+reliable}${rel:-best effort}" | sed 's/reliablerel/reliable/'
    "$NODE" --ros-args ${rel:+-p reliability:=reliable} >"$out/node.txt" 2>&1 &
    node=$!
    "$PY" "$here/play.py" "$folder" "$out/first.json" --frames 240 ${rel:+--reliable} >"$out/first.txt" 2>&1 &
    first=$!
    sleep 4
    "$PY" "$here/mutate.py" $node "$packets" 3 "$kind"
    wait $first
    "$PY" "$here/play.py" "$folder" "$out/then.json" --frames 90 --shift 100 ${rel:+--reliable} | sed 's/^/afterwards: /'
    kill -INT $node
    timeout 20 tail --pid=$node -f /dev/null || { echo "the node did not end"; kill -KILL $node; }
    wait $node
    grep -a 'panicked\|fault' "$out/node.txt"
  done
done
