#!/usr/bin/env python3
"""Makes the pictures of the manual from simulated rooms: python make.py STILLPOINT [WORK]. Needs Chromium on the path, and Pillow from PyPI.

STILLPOINT is the program, WORK a folder for its output (default: a temporary one). The pictures are docs/images/*.png, except rerun.png.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from PIL import Image, ImageOps

IMAGES = Path(__file__).resolve().parents[2] / "docs" / "images"
LARGEST = 200_000  # maximum size of a picture, bytes: pages load fast, and the repository stays small
VIEW = (547, 168, 1266, 556)  # the map's region in a page of that size, px
FRAME = 70  # of walking_xyz: a person walks past the desk
BROWSER = ["--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars", "--run-all-compositor-stages-before-draw", "--window-size=1280,800"]


def keep(image: Image.Image, name: str, width: int) -> None:
    """Writes a picture of at most this width, with as many colours as fit into the maximum size."""
    image = image.convert("RGB")
    if image.width > width:
        image = image.resize((width, round(image.height * width / image.width)), Image.Resampling.LANCZOS)
    path = IMAGES / name
    for colours in (256, 128, 64, 32):
        image.quantize(colours, dither=Image.Dither.NONE).save(path, optimize=True)
        if path.stat().st_size <= LARGEST:
            break
    print(f"{path.name}: {image.width}x{image.height}, {path.stat().st_size} bytes")


def shot(work: Path, url: str, *options: str) -> Image.Image:
    """A screenshot of an address in Chromium."""
    program = shutil.which("chromium") or shutil.which("google-chrome") or sys.exit("expected chromium on the path, found none; install it")
    path = work / "shot.png"
    command = [program, *BROWSER, f"--user-data-dir={work / 'browser'}", *options, f"--screenshot={path}", url]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=120)
    return Image.open(path).copy()


def live(program: str, work: Path, room: Path) -> Image.Image:
    """The page of a live run, some seconds after its start: the most detailed of several screenshots, since rendering may be late."""
    command = [program, "live", "file", str(room), "--detector", f"scripted:{room}/detections.csv", "--dense", "--view", "127.0.0.1:21399", "--out", str(work / "live")]
    pictures = []
    for wait in (4000, 5000, 6000):
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as run:
            time.sleep(0.5)
            pictures.append(shot(work, "http://127.0.0.1:21399/", f"--timeout={wait}"))
            run.wait()
    return max(pictures, key=Image.Image.entropy)


def make(program: str, work: Path) -> None:
    def call(*arguments: str) -> None:
        subprocess.run([program, *arguments, "--quiet"], check=True, cwd=work)

    room, out = work / "room", work / "out"
    call("simulate", "--scene", "walking_xyz", "--frames", "240", "--out", "room")
    call("run", "room", "--detector", "scripted:room/detections.csv", "--dense", "--overlay", "overlay", "--masks", "masks", "--out", "out")
    page = f"file://{out / 'report.html'}#frame={FRAME}"
    report = shot(work, page, "--virtual-time-budget=8000")
    keep(report, "report.png", 900)
    keep(report.crop(VIEW), "surface.png", 720)
    keep(shot(work, f"{page}&view=top", "--virtual-time-budget=8000").crop(VIEW), "map.png", 720)
    keep(live(program, work, room), "live.png", 900)
    keep(Image.open(work / "overlay" / f"{FRAME:06}.png"), "overlay.png", 640)
    colour = sorted((room / "rgb").iterdir())[FRAME]
    pair = Image.new("RGB", (1290, 480), "white")
    pair.paste(Image.open(colour), (0, 0))
    pair.paste(Image.open(work / "masks" / colour.name).convert("RGB"), (650, 0))
    keep(pair, "masks.png", 900)
    plan = ImageOps.expand(Image.open(out / "grid.pgm"), 2, 128)
    keep(plan.resize((plan.width * 4, plan.height * 4), Image.Resampling.NEAREST), "plan.png", 480)
    keep(Image.open(out / "plot.png"), "errors.png", 900)
    call("simulate", "--scene", "crowd_pitch", "--frames", "41", "--out", "pitch")
    keep(Image.open(sorted((work / "pitch" / "rgb").iterdir())[-1]), "pitch.png", 480)


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    if len(sys.argv) == 3:
        Path(sys.argv[2]).mkdir(parents=True, exist_ok=True)
        make(str(Path(sys.argv[1]).resolve()), Path(sys.argv[2]).resolve())
    else:
        with tempfile.TemporaryDirectory() as folder:
            make(str(Path(sys.argv[1]).resolve()), Path(folder))
