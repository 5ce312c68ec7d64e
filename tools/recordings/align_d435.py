"""Writes a depth image of librealsense's test recording aligned to the colour camera by `rs.align` of PyPI `pyrealsense2` 2.59.
usage: align_d435.py d435_640x480.bag OUT.png      pip install pyrealsense2 numpy pillow; needs libusb-1.0-0 of the system
Values are millimetres along the depth camera's axis, which rs.align does not convert."""
import sys

import numpy as np
import pyrealsense2 as rs
from PIL import Image

config = rs.config()
config.enable_device_from_file(sys.argv[1], repeat_playback=False)
pipeline = rs.pipeline()
pipeline.start(config).get_device().as_playback().set_real_time(False)
frames = pipeline.wait_for_frames(5000)
depth = rs.align(rs.stream.color).process(frames).get_depth_frame()
print("depth of", frames.get_depth_frame().get_timestamp(), "ms, colour of", frames.get_color_frame().get_timestamp(), "ms")
Image.fromarray(np.asanyarray(depth.get_data())).save(sys.argv[2], optimize=True)
