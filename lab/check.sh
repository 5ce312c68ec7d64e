#!/usr/bin/env bash
# The lab's own gate: format, lints and tests, its end-to-end tests included. They run the command line as this workspace builds it (tests/program.rs).
# What cargo has compiled for the root can be used again: CARGO_TARGET_DIR=$PWD/target lab/check.sh
set -euo pipefail
cd "$(dirname "$0")"
export CARGO_TERM_COLOR=never CARGO_INCREMENTAL=0 CARGO_PROFILE_DEV_DEBUG=0

step() { printf '\n== %s\n' "$*"; "$@"; }

step cargo fmt --check
step cargo clippy --all-targets --locked -- -D warnings
step cargo test --locked --no-fail-fast
