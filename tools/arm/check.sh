#!/usr/bin/env bash
# What shows that kernels for 64-bit Arm give the bits of their scalar twins: the tests that compare them, under qemu. All other tests: cargo.sh.
#
# Usage: ARM_ROOT=FOLDER tools/arm/check.sh      (setup.sh fills FOLDER; the first build takes some minutes)
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
cd "$here/../.."
# The names of tests that compare kernels have one of these words in them.
exec "$here/cargo.sh" test --locked --lib --tests -p stillpoint-imaging -p stillpoint-features -p stillpoint-dense -p stillpoint-place -- \
  vector kernels portable any_instructions the_machine_has scores_are weigh_most
