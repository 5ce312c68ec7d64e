#!/usr/bin/env bash
# Counts the instructions of kernels, with and without SIMD, on x86-64 and on 64-bit Arm, both under qemu with a counting plugin.
# Prints a table in Markdown, in thousands of instructions. Instructions are not time: see docs/arm.md.
#
# Usage: ARM_ROOT=FOLDER tools/arm/count.sh [KERNEL ...]      (FOLDER made by setup.sh; needs a C compiler; the first build takes some minutes)
set -euo pipefail
: "${ARM_ROOT:?expected the folder that tools/arm/setup.sh filled}"
here=$(cd "$(dirname "$0")" && pwd)
cd "$here/../.."
kernels=("$@")
[ $# != 0 ] || kernels=(gray scale smooth corners orientation descriptors extract flow distances words fuse frame)
if [ ! -x "$ARM_ROOT/usr/bin/qemu-x86_64" ]; then
  echo "expected $ARM_ROOT/usr/bin/qemu-x86_64, found none: run tools/arm/setup.sh $ARM_ROOT again" >&2
  exit 2
fi
cargo build --release --manifest-path lab/Cargo.toml
"$here/cargo.sh" build --release --manifest-path lab/Cargo.toml
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
${CC:-cc} -O2 -Wall -shared -fPIC -o "$scratch/count.so" "$here/count.c"
native=${CARGO_TARGET_DIR:-lab/target}/release/lab
"$native" kernels "$scratch/images" --render
export LD_LIBRARY_PATH=$ARM_ROOT/usr/lib/x86_64-linux-gnu STILLPOINT_WORKERS=1

# Instructions of a run: ARCHITECTURE KERNEL scalar|vector TIMES.
run() {
  local emulator
  case $1 in
    x86_64) emulator=("$ARM_ROOT/usr/bin/qemu-x86_64" -cpu max -plugin "$scratch/count.so" "$native") ;;
    aarch64) emulator=("$ARM_ROOT/usr/bin/qemu-aarch64" -L "$ARM_ROOT/usr/aarch64-linux-gnu" -plugin "$scratch/count.so"
      "${CARGO_TARGET_DIR:-target/arm}/aarch64-unknown-linux-gnu/release/lab") ;;
  esac
  local how=()
  [ "$3" = vector ] || how=(--scalar)
  "${emulator[@]}" kernels "$scratch/images" "$2" "${how[@]}" --times "$4" 2>&1 >"$scratch/$1-$3" | sed -n 's/^instructions //p'
}

# Thousands of instructions per repetition, from the difference of two runs. For `frame` the first frames, which build the map, are left out.
once() {
  local few=1 many=3
  [ "$2" != frame ] || few=8 many=24
  local least most
  least=$(run "$1" "$2" "$3" $few)
  most=$(run "$1" "$2" "$3" $many)
  echo $(((most - least) / (many - few) / 1000))
}

echo "| kernel | x86-64, scalar | AVX2 | ratio | Arm, scalar | NEON | ratio |"
echo "|---|---:|---:|---:|---:|---:|---:|"
for kernel in "${kernels[@]}"; do
  numbers=()
  for architecture in x86_64 aarch64; do
    scalar=$(once $architecture "$kernel" scalar)
    vector=$(once $architecture "$kernel" vector)
    ratio=$(awk -v a="$scalar" -v b="$vector" 'BEGIN { printf "%.1f", a / b }')
    numbers+=("$scalar | $vector | $ratio")
  done
  # All must give the same result, apart from the name of the instruction set.
  for other in x86_64-vector aarch64-scalar aarch64-vector; do
    if [ "$(sed 's/.*: //' "$scratch/x86_64-scalar")" != "$(sed 's/.*: //' "$scratch/$other")" ]; then
      echo "$kernel: expected the result of x86_64-scalar, found another of $other" >&2
      exit 1
    fi
  done
  printf '| %s | %s | %s |\n' "$kernel" "${numbers[@]}"
done
