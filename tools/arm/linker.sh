#!/usr/bin/env bash
# The compiler of C that setup.sh unpacked, which links too. The C library's linker script names its parts by where they would be installed, which is below the folder.
export LD_LIBRARY_PATH=$ARM_ROOT/usr/lib/x86_64-linux-gnu
exec "$ARM_ROOT/usr/bin/aarch64-linux-gnu-gcc-12" -B"$ARM_ROOT/usr/bin/aarch64-linux-gnu-" -Wl,--sysroot="$ARM_ROOT" "$@"
