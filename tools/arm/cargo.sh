#!/usr/bin/env bash
# cargo for 64-bit Arm: built programs run under qemu. Needs ARM_ROOT, the folder made by setup.sh.
#
# Usage: ARM_ROOT=FOLDER tools/arm/cargo.sh test -p stillpoint-imaging ...
set -euo pipefail
: "${ARM_ROOT:?expected the folder that tools/arm/setup.sh filled}"
export ARM_ROOT
here=$(cd "$(dirname "$0")" && pwd)
export RUSTC=$here/rustc.sh CARGO_INCREMENTAL=0
export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=$here/linker.sh
export CC_aarch64_unknown_linux_gnu=$here/linker.sh AR_aarch64_unknown_linux_gnu=$here/ar.sh
export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER="$ARM_ROOT/usr/bin/qemu-aarch64-static -L $ARM_ROOT/usr/aarch64-linux-gnu"
export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$here/../../target/arm}
command=$1
shift
exec cargo "$command" --target aarch64-unknown-linux-gnu "$@"
