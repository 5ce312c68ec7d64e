"""Writes frames of a TUM folder for fast_peer: dump.py FOLDER FRAMES.bin [MOST]"""
import pathlib
import struct
import sys

import cv2
import numpy as np

from play import FR1, pairs

folder = pathlib.Path(sys.argv[1])
frames = pairs(folder, int(sys.argv[3]) if len(sys.argv) > 3 else None)
with open(sys.argv[2], "wb") as out:
    out.write(struct.pack("<III", len(frames), 640, 480))
    out.write(struct.pack("<9d", FR1["fx"], FR1["fy"], FR1["cx"], FR1["cy"], *FR1["d"]))
    for stamp, colour, depth_stamp, depth in frames:
        rgb = cv2.cvtColor(cv2.imread(str(colour)), cv2.COLOR_BGR2RGB)
        mm = np.rint(cv2.imread(str(depth), cv2.IMREAD_UNCHANGED) * 0.2).astype("<u2")
        ns = [round(s * 1e6) * 1000 for s in (stamp, depth_stamp)]
        out.write(struct.pack("<dqq", stamp, *ns) + rgb.tobytes() + mm.tobytes())
