"""A fake of the package `ultralytics`, without weights: the same calls and shapes, with boxes from the file `STANDIN_BOXES` for the frames of the
simulated room in the folder `STANDIN_ROOM`, in order.
"""

from __future__ import annotations

import csv
import os

import numpy as np

CLASSES = {"person": 0, "chair": 56}


class Tensor:
    """The minimal interface of a tensor for reading its values."""

    def __init__(self, values: np.ndarray, is_on_host: bool = False) -> None:
        self.values, self.is_on_host = values, is_on_host

    def cpu(self) -> Tensor:
        return Tensor(self.values, True)

    def numpy(self) -> np.ndarray:
        if not self.is_on_host:
            raise TypeError("can't convert a tensor of another device to numpy; use .cpu() first")
        return self.values


class Boxes:
    def __init__(self, rows: list[list[float]]) -> None:
        # x0, y0, x1, y1 relative to the corner of the first pixel, confidence, class.
        self.data = Tensor(np.array(rows, dtype=np.float64).reshape(-1, 6))


class Results:
    def __init__(self, rows: list[list[float]], image: np.ndarray) -> None:
        self.boxes, self.orig_img, self.orig_shape = Boxes(rows), image, image.shape[:2]


class YOLO:
    def __init__(self, model: str) -> None:
        assert model.endswith(".pt")
        with open(os.environ["STANDIN_BOXES"], newline="") as file:
            rows = list(csv.DictReader(file))
        with open(os.path.join(os.environ["STANDIN_ROOM"], "rgb.txt")) as file:
            self.stamps = [line.split()[0] for line in file if not line.startswith("#")]
        self.rows = {s: [r for r in rows if r["timestamp"] == s] for s in self.stamps}
        assert sum(map(len, self.rows.values())) == len(rows)
        self.calls = 0

    def __call__(self, image: np.ndarray, *, verbose: bool = True) -> list[Results]:
        assert image.dtype == np.uint8 and image.ndim == 3 and image.shape[2] == 3 and not verbose
        seen = self.rows[self.stamps[self.calls]]
        self.calls += 1
        corners = ("x0", "y0", "x1", "y1")
        return [Results([[float(r[c]) + 0.5 for c in corners] + [float(r["score"]), CLASSES[r["class"]]] for r in seen], image)]
