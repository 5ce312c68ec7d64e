"""An Intel RealSense camera, or a recording of one: python realsense.py [RECORDING]. Needs pyrealsense2."""
import sys
import numpy as np
import pyrealsense2 as rs
import stillpoint_slam as sp

config, pipeline, align, slam = rs.config(), rs.pipeline(), rs.align(rs.stream.color), None
if len(sys.argv) > 1:
    config.enable_device_from_file(sys.argv[1], repeat_playback=False)
else:
    config.enable_stream(rs.stream.depth, 640, 480, rs.format.z16, 30)
    config.enable_stream(rs.stream.color, 640, 480, rs.format.rgb8, 30)
pipeline.start(config)
while (arrived := pipeline.try_wait_for_frames(5000))[0]:
    depth, color = (f := align.process(arrived[1])).get_depth_frame(), f.get_color_frame()
    lens = color.profile.as_video_stream_profile().intrinsics
    slam = slam or sp.Slam(sp.Camera.from_info(lens, depth_scale=1 / depth.get_units()))
    stamps = [f.timestamp / 1e3 for f in (color, depth)]
    print(slam.track(stamps[0], np.asarray(color.data), np.asarray(depth.data), depth_stamp=stamps[1]))
