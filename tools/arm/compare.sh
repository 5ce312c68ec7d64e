#!/usr/bin/env bash
# Runs 30 frames of a simulated room on this machine and as 64-bit Arm under qemu, and compares the bytes of trajectories, keyframes and map.
#
# Usage: ARM_ROOT=FOLDER tools/arm/compare.sh [SCENE]      (FOLDER made by setup.sh; the first build takes some minutes)
set -euo pipefail
: "${ARM_ROOT:?expected the folder that tools/arm/setup.sh filled}"
scene=${1:-walking_xyz}
here=$(cd "$(dirname "$0")" && pwd)
cd "$here/../.."
cargo build --release -p stillpoint-cli
"$here/cargo.sh" build --release -p stillpoint-cli
ours=${CARGO_TARGET_DIR:-target}/release/stillpoint
arm=${CARGO_TARGET_DIR:-target/arm}/aarch64-unknown-linux-gnu/release/stillpoint
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
"$ours" simulate --scene "$scene" --frames 30 --out "$out/room" >/dev/null
run() { # NAME COMMAND...
  local name=$1
  shift
  "$@" run "$out/room" --detector "scripted:$out/room/detections.csv" --no-report --out "$out/$name" --save-map "$out/$name.spmap" | grep -m 1 ATE
}
run here "$ours"
run arm "$ARM_ROOT/usr/bin/qemu-aarch64-static" -L "$ARM_ROOT/usr/aarch64-linux-gnu" "$arm"
for file in trajectory.txt trajectory_online.txt keyframes.txt frames.csv; do cmp "$out/here/$file" "$out/arm/$file"; done
cmp "$out/here.spmap" "$out/arm.spmap"
echo "$scene: the same bytes on both"
