"""Records a data set folder through librealsense's software device, with the depth camera 15 mm beside the colour camera.

    python software_realsense.py FOLDER OUT.db3 FRAMES

Needs PyPI `pyrealsense2`, `numpy` and `pillow`. The folder is in the TUM layout with a `camera.toml` without distortion, as from `stillpoint simulate`. With
`imu.csv` (`stillpoint simulate --imu`) gyroscope and accelerometer are recorded as on a D435i, in separate streams, with the mount of `camera.toml`.
"""

import os
import re
import sys
import time

import numpy as np
import pyrealsense2 as rs
from PIL import Image

BESIDE = 0.015
folder, out, count = sys.argv[1], sys.argv[2], int(sys.argv[3])
camera = dict(re.findall(r"^(fx|fy|cx|cy|depth_scale)\s*=\s*([\d.]+)", open(f"{folder}/camera.toml").read(), re.M))
fx, fy, cx, cy = (float(camera[k]) for k in ("fx", "fy", "cx", "cy"))
scale = float(camera.get("depth_scale", 5000))


def listed(name):
    rows = [line.split() for line in open(f"{folder}/{name}.txt") if not line.startswith("#")]
    return [(float(stamp), f"{folder}/{path}") for stamp, path in rows]


def inertial():
    """Samples as (stamp, rates, forces), and the sensor's mount: rotation from the sensor to the camera, and position."""
    if not os.path.exists(f"{folder}/imu.csv"):
        return [], None
    rows = [[float(v) for v in line.split(",")] for line in open(f"{folder}/imu.csv") if not line.startswith("#")]
    table = open(f"{folder}/camera.toml").read().split("[imu]")[1]
    numbers = {k: [float(v) for v in vs.split(",")] for k, vs in re.findall(r"^(\w+)\s*=\s*\[([^\]]*)\]", table, re.M)}
    x, y, z, w = numbers["rotation"]
    rotation = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    # Device time starts at 0.
    return [(r[0], r[1:4], r[4:7]) for r in rows if r[0] >= 0], (np.array(rotation), numbers["translation"])


def beside(depth):
    """The depth image (mm) of a camera to the right. Along a row inverse depth is linear on every plane: between neighbours on one surface it is interpolated
    at the other camera's pixels; the nearest surface wins."""
    z = depth / scale
    w = np.divide(1.0, z, out=np.zeros(z.shape), where=z > 0)
    at = np.arange(depth.shape[1]) - fx * BESIDE * w
    left, right, step = at[:, :-1], at[:, 1:], w[:, 1:] - w[:, :-1]
    pixel = np.ceil(left).astype(int)
    joined = (w[:, :-1] > 0) & (w[:, 1:] > 0) & (np.abs(step) < 0.02 * w[:, :-1])
    v, u = np.nonzero(joined & (pixel < right) & (pixel >= 0))
    share = (pixel[v, u] - left[v, u]) / (right[v, u] - left[v, u])
    inverse = w[v, u] + share * step[v, u]
    nearest = np.zeros(depth.shape)
    np.maximum.at(nearest, (v, pixel[v, u]), inverse)
    return np.rint(np.divide(1000.0, nearest, out=np.zeros(z.shape), where=nearest > 0)).astype(np.uint16)


colours, depths = listed("rgb")[:count], listed("depth")[:count]
height, width = np.asarray(Image.open(colours[0][1])).shape[:2]


def stream(kind, number, form, size):
    s = rs.video_stream()
    s.type, s.index, s.uid, s.fmt, s.bpp = kind, 0, number, form, size
    s.width, s.height, s.fps = width, height, 30
    i = rs.intrinsics()
    i.width, i.height, i.fx, i.fy, i.ppx, i.ppy = width, height, fx, fy, cx, cy
    i.model, i.coeffs = rs.distortion.none, [0] * 5
    s.intrinsics = i
    return s


for end in ("", "-shm", "-wal"):
    if os.path.exists(out + end):
        os.remove(out + end)
device = rs.software_device()
sensors = device.add_sensor("Stereo Module"), device.add_sensor("RGB Camera")
depth_profile = sensors[0].add_video_stream(stream(rs.stream.depth, 1, rs.format.z16, 2))
colour_profile = sensors[1].add_video_stream(stream(rs.stream.color, 2, rs.format.rgb8, 3))
sensors[0].add_read_only_option(rs.option.depth_units, 0.001)
pose = rs.extrinsics()
pose.rotation, pose.translation = [1, 0, 0, 0, 1, 0, 0, 0, 1], [BESIDE, 0, 0]
depth_profile.register_extrinsics_to(colour_profile, pose)
samples, mount = inertial()
motion = []
if samples:
    module = device.add_sensor("Motion Module")
    for number, kind in ((3, rs.stream.gyro), (4, rs.stream.accel)):
        m = rs.motion_stream()
        m.type, m.index, m.uid, m.fmt, m.fps = kind, 0, number, rs.format.motion_xyz32f, 200
        motion.append(module.add_motion_stream(m))
    stands = rs.extrinsics()
    # Column-major.
    stands.rotation, stands.translation = mount[0].T.ravel().tolist(), mount[1]
    for profile in motion:
        profile.register_extrinsics_to(colour_profile, stands)
recorder = rs.recorder(out, device)
recorded = recorder.query_sensors()
queue = rs.frame_queue(50, keep_frames=True)
for sensor, profile in zip(recorded, (depth_profile, colour_profile)):
    sensor.open(profile)
    sensor.start(queue)
if samples:
    recorded[2].open(motion)
    recorded[2].start(queue)
kept = []


def hand_over(sensor, profile, pixels, size, stamp, number):
    frame = rs.software_video_frame()
    frame.stride, frame.bpp, frame.pixels = width * size, size, pixels
    frame.timestamp, frame.frame_number = stamp * 1e3, number
    frame.domain, frame.profile = rs.timestamp_domain.hardware_clock, profile.as_video_stream_profile()
    if size == 2:
        frame.depth_units = 0.001
    kept.append(pixels)
    sensor.on_video_frame(frame)


def measure(until):
    """Passes on the samples up to a time."""
    while samples and samples[0][0] <= until:
        stamp, rate, force = samples.pop(0)
        for profile, values in zip(motion, (rate, force)):
            frame = rs.software_motion_frame()
            vector = rs.vector()
            vector.x, vector.y, vector.z = values
            frame.data = vector
            frame.timestamp, frame.frame_number = stamp * 1e3, 0
            frame.domain, frame.profile = rs.timestamp_domain.hardware_clock, profile.as_motion_stream_profile()
            module.on_motion_frame(frame)


for number, ((stamp, colour), (depth_stamp, depth)) in enumerate(zip(colours, depths)):
    started = time.monotonic()
    pixels = np.ascontiguousarray(np.asarray(Image.open(colour).convert("RGB")))
    moved = beside(np.asarray(Image.open(depth)))
    measure(max(stamp, depth_stamp))
    hand_over(sensors[0], depth_profile, moved, 2, depth_stamp, number)
    hand_over(sensors[1], colour_profile, pixels, 3, stamp, number)
    time.sleep(max(0.0, 1 / 30 - (time.monotonic() - started)))
measure(colours[-1][0] + 0.01)
time.sleep(0.5)
for sensor in recorded:
    sensor.stop()
    sensor.close()
del recorder
print(f"{len(colours)} frames, {os.path.getsize(out)} bytes")
