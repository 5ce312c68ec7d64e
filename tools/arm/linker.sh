#!/usr/bin/env bash
# The C compiler unpacked by setup.sh, also used as linker. The C library's linker script has absolute paths, so the folder is the sysroot.
export LD_LIBRARY_PATH=$ARM_ROOT/usr/lib/x86_64-linux-gnu
exec "$ARM_ROOT/usr/bin/aarch64-linux-gnu-gcc-12" -B"$ARM_ROOT/usr/bin/aarch64-linux-gnu-" -Wl,--sysroot="$ARM_ROOT" "$@"
