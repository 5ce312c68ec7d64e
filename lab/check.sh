#!/usr/bin/env bash
# The lab's own gate: format, lints and tests, its end-to-end tests included. They run the command line as this workspace builds it (tests/program.rs).
# What cargo has compiled for the root can be used again: CARGO_TARGET_DIR=$PWD/target lab/check.sh
#
#   lab/check.sh [PROFILES.toml]      cargo's configuration with the profile to build with (.ci/profiles)
set -euo pipefail
cd "$(dirname "$0")"
profiles=${1:-}
if [ -z "$profiles" ]; then
  profiles=$(mktemp --suffix .toml)
  trap 'rm -f "$profiles"' EXIT
  ../.ci/profiles >"$profiles"
fi
export CARGO_TERM_COLOR=never CARGO_INCREMENTAL=0 CARGO_PROFILE_DEV_DEBUG=0

step() { printf '\n== %s\n' "$*"; "$@"; }

step cargo fmt --check
# Lints while compiling, as the root's gate does.
export RUSTC_WORKSPACE_WRAPPER=$PWD/../.ci/rustc CLIPPY_ARGS=-Dwarnings
step cargo test --config "$profiles" --locked --no-fail-fast
