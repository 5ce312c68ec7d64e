"""Uses your own detector: python yolo.py PATH. Needs ultralytics; any function from an RGB image to rows of x0, y0, x1, y1, score, class will do."""

import sys

import numpy as np
import ultralytics

import stillpoint_slam as sp

network = ultralytics.YOLO("yolo11n.pt")


def people_and_things(image: np.ndarray) -> np.ndarray:
    boxes: np.ndarray = network(image[..., ::-1], verbose=False)[0].boxes.data.cpu().numpy()
    return boxes - [0.5, 0.5, 0.5, 0.5, 0, 0]  # The centre of the first pixel is at 0 here, and at 0.5 in ultralytics.


result = sp.run(sys.argv[1], detector=people_and_things, out="out")
print(result, result.slam.map)
