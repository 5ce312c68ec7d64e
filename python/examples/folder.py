"""Runs a data set folder or a recording: python folder.py PATH [TRAJECTORY.txt]"""

import sys

import stillpoint_slam as sp

recording = sp.open(sys.argv[1])
with sp.Slam(recording.camera) as slam:
    for image in recording:
        frame = slam.track(image.stamp, image.color, image.depth, depth_stamp=image.depth_stamp)
        if not frame.is_tracked:
            print(f"frame {frame.index}: {frame.reason}")
print(slam)
if recording.truth is not None:
    print(sp.evaluate(recording.truth, slam.trajectory()))
slam.trajectory().save(sys.argv[2] if len(sys.argv) > 2 else "trajectory.txt")
