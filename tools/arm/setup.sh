#!/usr/bin/env bash
# Unpacks tools to compile for 64-bit Arm and to run the programs here into a folder: Debian's cross compiler and linker, its Rust compiler with the
# standard library for Arm, and qemu twice: a static one, and one with plugins, for count.sh. Changes only the system's list of architectures and apt's
# lists, not rustup.
#
# Usage: tools/arm/setup.sh FOLDER      (Debian 12 on x86-64, as root; some 1.5 GB)
set -euo pipefail
root=$(mkdir -p "${1:?usage: setup.sh FOLDER}" && cd "$1" && pwd)
dpkg --add-architecture arm64
apt-get update -q
packages=$(mktemp -d)
trap 'rm -rf "$packages"' EXIT
cd "$packages"
chmod 777 .
version=$(apt-cache depends rustc-web | sed -n 's/.*\(libstd-rust-web-[0-9.]*\)$/\1/p' | head -n 1)
[ -n "$version" ] || version=$(apt-cache search --names-only '^libstd-rust-web-[0-9.]+$' | sort -V | tail -n 1 | cut -d' ' -f1)
llvm=$(apt-cache depends "$version" | sed -n 's/.*Depends: \(libllvm[0-9]*\)$/\1/p' | head -n 1)
apt-get download -q rustc-web "$version" "$llvm" libstd-rust-web-dev libstd-rust-web-dev:arm64 qemu-user-static \
  gcc-12-aarch64-linux-gnu cpp-12-aarch64-linux-gnu binutils-aarch64-linux-gnu libgcc-12-dev-arm64-cross libgcc-s1-arm64-cross \
  libc6-arm64-cross libc6-dev-arm64-cross linux-libc-dev-arm64-cross libbinutils libisl23 libmpc3 libmpfr6 libjansson4 \
  qemu-user libcapstone4 libnuma1 liburing2 libglib2.0-0
for package in *.deb; do dpkg -x "$package" "$root"; done
"$root"/usr/bin/qemu-aarch64-static --version | head -n 1
echo "tools for Arm in $root: use them with ARM_ROOT=$root tools/arm/cargo.sh test -p stillpoint-imaging"
