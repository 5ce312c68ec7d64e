"""Writes depth images compressed by PyPI's `rvl`, for tests of our decoder.

    python rvl_frames.py OUT.bin [FOLDER] [--frames 200]

Without a folder: generated images, small enough to be committed. With one: the depth images of a data set in the TUM layout, for
`STILLPOINT_RVL=OUT.bin cargo test -p stillpoint-imaging rvl`.
Format of each image: width, height and length as 32-bit numbers, the compressed bytes, and the values, all little-endian.
"""

import argparse
import struct
from pathlib import Path

import numpy as np
import rvl


def made(count):
    """Slopes with steps, holes and noise; one image is empty, one full, one has extreme values."""
    random = np.random.default_rng(1)
    for k in range(count):
        y, x = np.mgrid[0:30, 0:40]
        z = 600 + 30 * k + 7 * x + 3 * y + 900 * (x > 20) + random.integers(-2, 3, x.shape)
        z[random.random(x.shape) < 0.05 * k] = 0
        z[5:9, 3 * k : 3 * k + 6] = 0
        yield z
    yield np.zeros((30, 40))
    yield np.full((30, 40), 65535)
    yield random.integers(0, 65536, (30, 40))


def read(folder, count):
    from PIL import Image

    lines = (folder / "depth.txt").read_text().splitlines()
    paths = [line.split()[1] for line in lines if line and not line.startswith("#")]
    for path in paths[:count]:
        yield np.asarray(Image.open(folder / path))


parser = argparse.ArgumentParser()
parser.add_argument("out", type=Path)
parser.add_argument("folder", type=Path, nargs="?")
parser.add_argument("--frames", type=int, default=200)
args = parser.parse_args()
images = read(args.folder, args.frames) if args.folder else made(5)
count = 0
with args.out.open("wb") as out:
    for image in images:
        values = np.ascontiguousarray(image, dtype="<u2")
        # Removes the leading number of values, which image transports do not write.
        (size,) = struct.unpack_from("<I", packed := rvl.compress(values.tobytes()))
        assert size == values.size
        packed = packed[4:]
        out.write(struct.pack("<III", image.shape[1], image.shape[0], len(packed)) + packed + values.tobytes())
        count += 1
print(count, "images")
