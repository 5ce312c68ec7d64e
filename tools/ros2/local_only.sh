#!/usr/bin/env bash
# Tests the node's visibility to a peer on another machine, with ROS_LOCALHOST_ONLY and without: two connected network namespaces.
# usage: local_only.sh; needs root; environment as for track.sh
set -u
here=$(cd "$(dirname "$0")" && pwd)
if [ -z "${INSIDE:-}" ]; then
  INSIDE=1 exec unshare -n -m "$0" "$@"
fi
mount -t tmpfs tmpfs /run
ip link set lo up
ip netns add far
ip link add near type veth peer name far netns far
ip address add 10.9.0.1/24 dev near && ip link set near up multicast on
ip -n far address add 10.9.0.2/24 dev far && ip -n far link set far up multicast on && ip -n far link set lo up
ip route add 239.0.0.0/8 dev near
ip -n far route add 239.0.0.0/8 dev far
# The far peer contacts the port that cannot be bound to loopback.
export CYCLONEDDS_URI='<CycloneDDS><Domain><Discovery><Peers><Peer address="10.9.0.1:7400"/></Peers></Discovery></Domain></CycloneDDS>'
for only in 0 1; do
  ROS_LOCALHOST_ONLY=$only "$NODE" >/dev/null 2>&1 &
  node=$!
  sleep 1
  echo "ROS_LOCALHOST_ONLY=$only"
  echo "  addresses listened on: $(ss -ulnpH | grep -a "pid=$node," | awk '{print $4}' | sort | tr '\n' ' ')"
  echo "  readers and writers seen from the other machine: $(ip netns exec far "$PY" "$here/discovery.py" "$NODE" 4 --count)"
  kill -INT $node
  wait $node
done
