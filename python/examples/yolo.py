"""A detector of your own: python yolo.py PATH. Needs ultralytics; any function from an RGB image to rows of x0, y0, x1, y1, score, class will do."""

import sys

import numpy as np
import ultralytics

import stillpoint_slam as sp

network = ultralytics.YOLO("yolo11n.pt")


def people_and_things(image: np.ndarray) -> np.ndarray:
    boxes: np.ndarray = network(image[..., ::-1], verbose=False)[0].boxes.data.cpu().numpy()
    return boxes - [0.5, 0.5, 0.5, 0.5, 0, 0]  # Here the middle of the first pixel is at 0, there it is at 0.5.


result = sp.run(sys.argv[1], detector=people_and_things, out="out")
print(result, result.slam.map)
