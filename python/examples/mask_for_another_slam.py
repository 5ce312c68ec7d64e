"""Writes masks of moving regions for another SLAM: python mask_for_another_slam.py PATH FOLDER. Needs pillow to write images."""

import sys
from pathlib import Path

from PIL import Image

import stillpoint_slam as sp

recording, folder = sp.open(sys.argv[1]), Path(sys.argv[2])
folder.mkdir(parents=True, exist_ok=True)
moving = sp.DynamicMask(recording.camera)
for image in recording:
    mask = moving.step(image.stamp, image.color, image.depth, depth_stamp=image.depth_stamp).mask
    Image.fromarray(mask).save(folder / f"{image.stamp:.6f}.png")
