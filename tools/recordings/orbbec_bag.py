"""Writes a data set folder in the TUM layout as a bag of Orbbec's SDK 2, in the layout of its RosbagWriter.

    python orbbec_bag.py FOLDER OUT.bag [--frames 100]

Definitions: those of OrbbecSDK 2 for its bags. Depth is in millimetres in the colour camera (both cameras are the same).
"""

import argparse
import struct
from pathlib import Path

import numpy as np
from PIL import Image
from rosbags.rosbag1 import Writer

HEADER = "std_msgs/Header header\n"
OF_HEADER = "=" * 80 + "\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
IMAGE = HEADER + (
    "uint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data\n"
    "uint64 number\nuint64 timestamp_usec\nuint64 timestamp_systemusec\nuint64 timestamp_globalusec\nuint8[] metadata\n"
)
PROFILE = HEADER + (
    "uint8 streamType\nuint8 format\nfloat32[9] rotationMatrix\nfloat32[3] translationMatrix\nuint16 width\nuint16 height\nuint16 fps\n"
    "float32[4] cameraIntrinsic\nfloat32[8] cameraDistortion\nuint8 distortionModel\n"
)
DEVICE = HEADER + (
    "string name\nstring fullName\nstring asicName\nuint16 vid\nuint16 pid\nstring uid\nstring sn\nstring fwVersion\nstring hwVersion\n"
    "string supportedSdkVersion\nstring connectionType\nuint16 type\nuint8 backendType\nstring ipAddress\nstring localMac\n"
)
# Numbers of the sensors and their images.
COLOUR, DEPTH = 2, 3
# OB_FORMAT_RGB and OB_FORMAT_Y16.
RGB, Y16 = 22, 8


def text(value):
    data = value.encode()
    return struct.pack("<I", len(data)) + data


def header(ns):
    return struct.pack("<III", 0, ns // 10**9, ns % 10**9) + text("")


def image(ns, number, pixels, encoding):
    height, width = pixels.shape[:2]
    data = pixels.tobytes()
    out = header(ns) + struct.pack("<II", height, width) + text(encoding)
    out += struct.pack("<BI", 0, len(data) // height) + struct.pack("<I", len(data)) + data
    return out + struct.pack("<QQQQ", number, ns // 1000, ns // 1000, 0) + struct.pack("<I", 0)


def profile(ns, stream, form, size, k, d):
    rotation = [1, 0, 0, 0, 1, 0, 0, 0, 1] if stream == DEPTH else [0] * 9
    return header(ns) + struct.pack("<BB9f3f3H4f8fB", stream, form, *rotation, 0, 0, 0, *size, 30, *k, *d, 4)


def device(ns):
    out = header(ns) + text("Orbbec Femto Bolt") + text("Orbbec Femto Bolt") + text("") + struct.pack("<HH", 0x2BC5, 0x066B)
    out += b"".join(text(t) for t in ["0", "SERIAL", "1.0.0", "1.0", "2.0.0", "USB3.0"])
    return out + struct.pack("<HB", 0, 0) + text("") + text("")


def listed(folder, name):
    lines = (folder / name).read_text().splitlines()
    pairs = [line.split() for line in lines if line and not line.startswith("#")]
    return [(round(float(stamp) * 1e6) * 1000, path) for stamp, path in pairs]


def write(folder, out, frames, k, d):
    colours, depths = listed(folder, "rgb.txt")[:frames], listed(folder, "depth.txt")
    with Writer(out) as writer:
        def topic(name, kind, definition):
            return writer.add_connection(name, kind, msgdef=definition + OF_HEADER, md5sum="0123456789abcdef0123456789abcdef")

        colour = topic(f"/cam/sensor_{COLOUR}/frameType_{COLOUR}", "sensor_msgs/msg/Image", IMAGE)
        depth = topic(f"/cam/sensor_{DEPTH}/frameType_{DEPTH}", "sensor_msgs/msg/Image", IMAGE)
        about = {s: topic(f"/cam/streamProfileType_{s}", "custom_msg/msg/OBStreamProfileInfo", PROFILE) for s in (COLOUR, DEPTH)}
        info = topic("/cam/deviceInfo", "custom_msg/msg/OBDeviceInfo", DEVICE)
        start = colours[0][0]
        for number, (ns, path) in enumerate(colours):
            at, beside = min(depths, key=lambda p: abs(p[0] - ns))
            rgb = np.asarray(Image.open(folder / path).convert("RGB"))
            z = np.round(np.asarray(Image.open(folder / beside), dtype=np.float64) / 5).astype("<u2")
            writer.write(colour, ns, image(ns, number, rgb, "rgb8"))
            writer.write(depth, at, image(at, number, z, "mono16"))
        size = rgb.shape[1::-1]
        writer.write(about[COLOUR], start, profile(start, COLOUR, RGB, size, k, d))
        writer.write(about[DEPTH], start, profile(start, DEPTH, Y16, size, k, d))
        writer.write(info, start, device(start))


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--k", type=float, nargs=4, default=[517.3, 516.5, 318.6, 255.3])
    parser.add_argument("--d", type=float, nargs=8, default=[0.2624, -0.9531, 1.1633, 0, 0, 0, -0.0054, 0.0026], help="k1 to k6, p1, p2")
    args = parser.parse_args()
    write(args.folder, args.out, args.frames, args.k, args.d)
