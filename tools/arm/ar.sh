#!/usr/bin/env bash
# The archiver unpacked by setup.sh, for C libraries.
export LD_LIBRARY_PATH=$ARM_ROOT/usr/lib/x86_64-linux-gnu
exec "$ARM_ROOT/usr/bin/aarch64-linux-gnu-ar" "$@"
