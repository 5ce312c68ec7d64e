#!/usr/bin/env bash
# Prints the changes of ros2/vendor/rustdds relative to RustDDS on crates.io: upstream.sh [VERSION]; omitted files are not listed
set -eu
root=$(cd "$(dirname "$0")/../.." && pwd)
version=${1:-0.15.1}
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
mkdir "$scratch/src" && touch "$scratch/src/lib.rs"
printf '[package]\nname = "scratch"\nversion = "0.0.0"\nedition = "2024"\n[dependencies]\nrustdds = { version = "=%s", default-features = false }\n[workspace]\n' "$version" >"$scratch/Cargo.toml"
original=$(cd "$scratch" && cargo metadata --format-version 1 | python3 -c '
import json, pathlib, sys
packages = json.load(sys.stdin)["packages"]
print(next(pathlib.Path(p["manifest_path"]).parent for p in packages if p["name"] == "rustdds"))')
diff -ru "$original/src" "$root/ros2/vendor/rustdds/src" | grep -v '^Only in .*/registry/' || true
