#!/usr/bin/env bash
# Checks the lab: format, lints and tests. End-to-end tests run the command line as this workspace builds it (tests/program.rs).
# To reuse the root workspace's builds: CARGO_TARGET_DIR=$PWD/target lab/check.sh
#
#   lab/check.sh [PROFILES.toml]      cargo configuration with the build profile (.ci/profiles)
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
# Lints while compiling, as .ci/run does.
export RUSTC_WORKSPACE_WRAPPER=$PWD/../.ci/rustc CLIPPY_ARGS=-Dwarnings
step cargo test --config "$profiles" --locked --no-fail-fast
