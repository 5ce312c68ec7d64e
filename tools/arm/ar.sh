#!/usr/bin/env bash
# The archiver that setup.sh unpacked, for libraries in C.
export LD_LIBRARY_PATH=$ARM_ROOT/usr/lib/x86_64-linux-gnu
exec "$ARM_ROOT/usr/bin/aarch64-linux-gnu-ar" "$@"
