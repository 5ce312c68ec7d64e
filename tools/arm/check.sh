#!/usr/bin/env bash
# Tests that kernels for 64-bit Arm give the same bits as their scalar versions, under qemu. For all other tests use cargo.sh.
#
# Usage: ARM_ROOT=FOLDER tools/arm/check.sh      (FOLDER made by setup.sh; the first build takes some minutes)
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
cd "$here/../.."
# Names of tests that compare kernels contain one of these words.
exec "$here/cargo.sh" test --locked --lib --tests -p stillpoint-imaging -p stillpoint-features -p stillpoint-dense -p stillpoint-place -- \
  vector kernels portable any_instructions the_machine_has scores_are weigh_most
