"""Tracks an Intel RealSense camera, or a recording of one: python realsense.py [RECORDING]. Needs pyrealsense2."""
import sys
import numpy as np
import pyrealsense2 as rs
import stillpoint_slam as sp

config, pipeline, align, slam, last = rs.config(), rs.pipeline(), rs.align(rs.stream.color), None, -1.0
if len(sys.argv) > 1:
    config.enable_device_from_file(sys.argv[1], repeat_playback=False)
device = pipeline.start(config).get_device()
if len(sys.argv) > 1:
    device.as_playback().set_real_time(False)
while (arrived := pipeline.try_wait_for_frames(5000))[0]:
    depth, color = (f := align.process(arrived[1])).get_depth_frame(), f.get_color_frame()
    stamp, depth_stamp = color.timestamp / 1e3, depth.timestamp / 1e3
    if stamp > last:  # If one of the images is late, the other is delivered twice.
        slam = slam or sp.Slam(sp.Camera.from_info(color.profile.as_video_stream_profile().intrinsics, depth_scale=1 / depth.get_units()))
        print(slam.track(last := stamp, np.asarray(color.data), np.asarray(depth.data), depth_stamp=depth_stamp))
