"""Prints what the Python package trackeval says of two files: frame,id,x0,y0,x1,y1."""

import contextlib
import io
import sys

import numpy as np

with contextlib.redirect_stdout(io.StringIO()):
    from trackeval.metrics import CLEAR, HOTA, Identity


def read(path):
    rows = [line.split(",") for line in open(path).read().split()[1:]]
    return [(int(r[0]), int(r[1]), *map(float, r[2:])) for r in rows]


def iou(a, b):
    area = lambda c: (c[2] - c[0]) * (c[3] - c[1])
    w = max(0, min(a[2], b[2]) - max(a[0], b[0]))
    h = max(0, min(a[3], b[3]) - max(a[1], b[1]))
    return w * h / (area(a) + area(b) - w * h)


truth, found = read(sys.argv[1]), read(sys.argv[2])
frames = 1 + max(r[0] for r in truth + found)
number = [{k: n for n, k in enumerate(dict.fromkeys(r[1] for r in rows))} for rows in (truth, found)]
data = {
    "num_gt_ids": len(number[0]),
    "num_tracker_ids": len(number[1]),
    "num_gt_dets": len(truth),
    "num_tracker_dets": len(found),
    "num_timesteps": frames,
    "gt_ids": [],
    "tracker_ids": [],
    "similarity_scores": [],
}
for f in range(frames):
    t, d = ([r for r in rows if r[0] == f] for rows in (truth, found))
    data["gt_ids"].append(np.array([number[0][r[1]] for r in t], int))
    data["tracker_ids"].append(np.array([number[1][r[1]] for r in d], int))
    alike = [[iou(a[2:], b[2:]) for b in d] for a in t]
    data["similarity_scores"].append(np.array(alike).reshape(len(t), len(d)))
with contextlib.redirect_stdout(io.StringIO()):
    h = HOTA().eval_sequence(data)
    c = CLEAR({"PRINT_CONFIG": False}).eval_sequence(data)
    i = Identity({"PRINT_CONFIG": False}).eval_sequence(data)
for name in ("HOTA", "DetA", "AssA", "LocA"):
    print(float(np.mean(h[name])))
for name in ("MOTA", "MOTP", "CLR_TP", "CLR_FN", "CLR_FP", "IDSW", "Frag"):
    print(float(c[name]))
for name in ("IDF1", "IDP", "IDR"):
    print(float(i[name]))
