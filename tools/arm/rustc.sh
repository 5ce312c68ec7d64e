#!/usr/bin/env bash
# The compiler that setup.sh unpacked, as cargo calls it.
export LD_LIBRARY_PATH=$ARM_ROOT/usr/lib/x86_64-linux-gnu
exec "$ARM_ROOT/usr/bin/rustc" --sysroot "$ARM_ROOT/usr" "$@"
