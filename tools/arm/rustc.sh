#!/usr/bin/env bash
# The rustc unpacked by setup.sh, called by cargo.
export LD_LIBRARY_PATH=$ARM_ROOT/usr/lib/x86_64-linux-gnu
exec "$ARM_ROOT/usr/bin/rustc" --sysroot "$ARM_ROOT/usr" "$@"
