#!/usr/bin/env bash
# Makes docs/images/rerun.png, a screenshot of PyPI's `rerun-sdk` with a file written by --record. Needs `rerun` on the path (0.41), and without a screen
# `xvfb-run` and a software Vulkan (Debian: xvfb, mesa-vulkan-drivers). The argument is the program's path.
set -euo pipefail
stillpoint=$(realpath "${1:-target/release/stillpoint}")
target=$(realpath "$(dirname "$0")/../../docs/images")/rerun.png
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"$stillpoint" -q simulate --scene walking_xyz --frames 120 --out walk
"$stillpoint" -q run walk --detector scripted:walk/detections.csv --no-report --out result --record walk.mcap
show=(rerun walk.mcap --renderer vulkan --window-size 1280x760 --screenshot-to big.png)
if [ -n "${DISPLAY:-}" ]; then "${show[@]}"; else xvfb-run -a -s "-screen 0 1280x760x24" "${show[@]}"; fi
# Half of the device's pixels, with 256 colours, suffice for a page.
python3 - big.png "$target" <<'P'
import sys
from PIL import Image
big = Image.open(sys.argv[1]).convert("RGB")
small = big.resize((big.width * 1000 // big.width, big.height * 1000 // big.width), Image.LANCZOS)
small.quantize(256).save(sys.argv[2], optimize=True)
P
