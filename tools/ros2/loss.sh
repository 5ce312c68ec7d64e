#!/usr/bin/env bash
# Drops 5 % of all packets in a separate network namespace, and none afterwards: loss.sh FOLDER [rel]; needs root and nftables; environment as for track.sh
set -u
if [ -z "${INSIDE:-}" ]; then
  INSIDE=1 exec unshare -n "$0" "$@"
fi
here=$(cd "$(dirname "$0")" && pwd)
# shellcheck source=loopback.sh
. "$here/loopback.sh"
ip link set lo up
nft add table ip loss
nft add chain ip loss input '{ type filter hook input priority 0; }'
nft add rule ip loss input meta l4proto udp numgen random mod 100 '<' 5 drop || exit 1
out=$WORK/loss${2:-}
rm -rf "$out" && mkdir -p "$out"
"$NODE" --ros-args -p frames:=all ${2:+-p reliability:=reliable} >"$out/node.txt" 2>&1 &
node=$!
timeout 100 "$PY" "$here/play.py" "$1" "$out/heard.json" ${2:+--reliable} 2>/dev/null
echo "no packets are lost any more"
nft delete table ip loss
timeout 100 "$PY" "$here/play.py" "$1" "$out/then.json" --shift 100 ${2:+--reliable} 2>/dev/null
kill -INT $node
wait $node
cut -c1-400 "$out/node.txt"
