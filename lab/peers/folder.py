"""Reads a folder in TUM's layout with a camera.toml."""
import json
import resource
import time
import tomllib
from pathlib import Path

import cv2
import numpy as np

# Maximum time difference of associated colour and depth images, s: that of TUM's associate.py.
MAX_DIFFERENCE = 0.02

cv2.setNumThreads(1)


def rows(path):
    return [line.split() for line in Path(path).read_text().splitlines() if line.strip() and not line.startswith("#")]


class Folder:
    def __init__(self, path, frames=None):
        self.path = Path(path)
        self.camera = tomllib.loads((self.path / "camera.toml").read_text())
        self.lens = (list(self.camera.get("distortion", [])) + [0.0] * 5)[:5]
        depth = rows(self.path / "depth.txt")
        stamps = np.array([float(row[0]) for row in depth])
        self.pairs = []
        for stamp, name, *_ in rows(self.path / "rgb.txt"):
            nearest = int(np.abs(stamps - float(stamp)).argmin())
            if abs(stamps[nearest] - float(stamp)) <= MAX_DIFFERENCE:
                self.pairs.append((float(stamp), name, depth[nearest][1]))
        self.pairs = self.pairs[:frames]

    def images(self):
        """Yields stamps in s, colour images (BGR) and depth images in the file's units."""
        for stamp, colour, depth in self.pairs:
            yield stamp, cv2.imread(str(self.path / colour)), cv2.imread(str(self.path / depth), cv2.IMREAD_UNCHANGED)


class Clock:
    """Times of the calls that track a frame, ms."""

    def __init__(self):
        self.times = []

    def __enter__(self):
        self.begun = time.perf_counter()

    def __exit__(self, *_):
        self.times.append((time.perf_counter() - self.begun) * 1e3)

    def write(self, trajectory, frames):
        """Writes the figures for `lab peers` beside a trajectory. Times leave out the first frames, which build the map."""
        times = self.times[4:] or self.times
        said = {
            "frames": frames,
            "median_ms": float(np.median(times)),
            "p95_ms": float(np.percentile(times, 95)),
            "memory_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
        }
        Path(trajectory).with_suffix(".json").write_text(json.dumps(said))
