"""Writes the frames of a data set folder in the TUM layout as recordings, by other projects' libraries.

    python variants.py FOLDER OUT [--frames N]

OUT/lossless: ROS 1 bags (plain, lz4), rosbag2 data bases (plain, each message by Zstandard), MCAP (plain, lz4), with rgb8 and 16UC1.
OUT/compressed: a ROS 1 bag by bzip2, a rosbag2 data base by Zstandard as a whole, MCAP by Zstandard, with JPEG (quality 95) and compressedDepth (PNG).
OUT/float.mcap: rgb8 and 32FC1.
OUT/options: the first ten frames as MCAP with every option of PyPI `mcap`'s writer, with an attachment and metadata.
"""

import argparse
import io
import itertools
import re
import shutil
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from PIL import Image
from rosbags.rosbag1 import Writer as Bag
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2
from rosbags.typesys import Stores, get_typestore

FRAME = "camera_color_optical_frame"
COLOUR, DEPTH = "/camera/color", "/camera/aligned_depth_to_color"


class Folder:
    def __init__(self, path, count):
        self.path = path
        self.colours = self.listed("rgb.txt")[:count]
        last = self.colours[-1][0] + 50_000_000
        self.depths = [d for d in self.listed("depth.txt") if d[0] < last]
        text = (path / "camera.toml").read_text() if (path / "camera.toml").exists() else ""
        found = dict(re.findall(r"^(\w+)\s*=\s*([\d.]+)", text, re.M))
        # Default without a camera file: freiburg1.
        fallback = (517.306408, 516.469215, 318.643040, 255.313989)
        fx, fy, cx, cy = (float(found.get(k, f)) for k, f in zip(("fx", "fy", "cx", "cy"), fallback))
        self.k = [fx, 0, cx, 0, fy, cy, 0, 0, 1]
        self.d = [0.0] * 5 if text else [0.262383, -0.953104, -0.005358, 0.002628, 1.163314]

    def listed(self, name):
        rows = [line.split() for line in (self.path / name).read_text().splitlines() if line and line[0] != "#"]
        return [(int(s.replace(".", "").ljust(19, "0")), self.path / p) for s, p in rows]


class Messages:
    """Builds messages of one ROS version."""

    def __init__(self, ros1):
        self.ros1 = ros1
        self.store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
        self.types = self.store.types

    def header(self, ns, number):
        time = self.types["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
        more = {"seq": number} if self.ros1 else {}
        return self.types["std_msgs/msg/Header"](stamp=time, frame_id=FRAME, **more)

    def image(self, header, encoding, pixels):
        height, width = pixels.shape[:2]
        data = np.ascontiguousarray(pixels).reshape(-1).view(np.uint8)
        return self.types["sensor_msgs/msg/Image"](
            header=header, height=height, width=width, encoding=encoding, is_bigendian=0, step=len(data) // height, data=data
        )

    def compressed(self, header, form, data):
        return self.types["sensor_msgs/msg/CompressedImage"](header=header, format=form, data=np.frombuffer(data, np.uint8))

    def info(self, header, folder, size):
        roi = self.types["sensor_msgs/msg/RegionOfInterest"](x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        k = folder.k
        numbers = {"d": folder.d, "k": k, "r": np.eye(3).ravel(), "p": [*k[:3], 0, *k[3:6], 0, *k[6:], 0]}
        numbers = {(n.upper() if self.ros1 else n): np.array(v, dtype=np.float64) for n, v in numbers.items()}
        return self.types["sensor_msgs/msg/CameraInfo"](
            header=header, width=size[0], height=size[1], distortion_model="plumb_bob", binning_x=0, binning_y=0, roi=roi, **numbers
        )


def encoded(image, form, **options):
    out = io.BytesIO()
    image.save(out, form, **options)
    return out.getvalue()


def events(folder, messages, kind):
    """(log time, topic, message) in order; `kind` is raw, compressed or float."""
    found = []
    for number, (ns, path) in enumerate(folder.colours):
        header, image = messages.header(ns, number), Image.open(path).convert("RGB")
        at = ns + 2_000_000
        if kind == "compressed":
            data = encoded(image, "JPEG", quality=95)
            found.append((at, f"{COLOUR}/image_raw/compressed", messages.compressed(header, "rgb8; jpeg compressed bgr8", data)))
        else:
            found.append((at, f"{COLOUR}/image_raw", messages.image(header, "rgb8", np.asarray(image))))
        found.append((at, f"{COLOUR}/camera_info", messages.info(header, folder, image.size)))
    for number, (ns, path) in enumerate(folder.depths):
        header, raw = messages.header(ns, number), np.asarray(Image.open(path)).astype(np.uint32)
        mm, at = ((raw + 2) // 5).astype("<u2"), ns + 3_000_000
        if kind == "compressed":
            data = bytes(12) + encoded(Image.fromarray(mm), "PNG")
            found.append((at, f"{DEPTH}/image_raw/compressedDepth", messages.compressed(header, "16UC1; compressedDepth png", data)))
        elif kind == "float":
            metres = np.where(raw == 0, np.nan, raw / 5000).astype("<f4")
            found.append((at, f"{DEPTH}/image_raw", messages.image(header, "32FC1", metres)))
        else:
            found.append((at, f"{DEPTH}/image_raw", messages.image(header, "16UC1", mm)))
    return sorted(found, key=lambda event: event[0])


def bag(out, folder, kind, compression=None):
    messages = Messages(True)
    writer = Bag(out)
    if compression:
        writer.set_compression(compression)
    with writer:
        topics = {}
        for ns, topic, message in events(folder, messages, kind):
            name = message.__msgtype__
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, name, typestore=messages.store)
            writer.write(topics[topic], ns, messages.store.serialize_ros1(message, name))


def data_base(out, folder, kind, mode=None):
    messages = Messages(False)
    writer = Rosbag2(out, version=9, storage_plugin=StoragePlugin.SQLITE3)
    if mode:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        topics = {}
        for ns, topic, message in events(folder, messages, kind):
            name = message.__msgtype__
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, name, typestore=messages.store)
            writer.write(topics[topic], ns, messages.store.serialize_cdr(message, name))


def mcap(out, folder, kind, compression):
    messages = Messages(False)
    with open(out, "wb") as file:
        writer = McapWriter(file, compression=compression)
        writer.start("ros2", "variants")
        topics = {}
        for ns, topic, message in events(folder, messages, kind):
            name = message.__msgtype__
            if topic not in topics:
                text = messages.store.generate_msgdef(name, ros_version=2)[0]
                schema = writer.register_schema(name, "ros2msg", text.encode())
                topics[topic] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(topics[topic], ns, bytes(messages.store.serialize_cdr(message, name)), ns)
        writer.finish()


def options(source, out):
    """Rewrites the messages of an MCAP file with every combination of options."""
    with open(source, "rb") as file:
        read = list(make_reader(file).iter_messages())
    sizes = {True: (1024, 1 << 20), False: (1 << 20,)}
    kinds = {True: list(CompressionType), False: [CompressionType.NONE]}
    some = [IndexType.NONE, IndexType.MESSAGE, IndexType.ALL]
    flags = itertools.product((True, False), repeat=5)
    number = 0
    for chunked, repeated, statistics, offsets, sums in flags:
        for size, compression, index in itertools.product(sizes[chunked], kinds[chunked], some):
            with open(out / f"{number:03}.mcap", "wb") as file:
                writer = McapWriter(
                    file,
                    chunk_size=size,
                    compression=compression,
                    index_types=index,
                    repeat_channels=repeated,
                    repeat_schemas=repeated,
                    use_chunking=chunked,
                    use_statistics=statistics,
                    use_summary_offsets=offsets,
                    enable_crcs=sums,
                    enable_data_crcs=sums,
                )
                writer.start("ros2", "variants")
                writer.add_attachment(1, 1, "note.txt", "text/plain", b"attached")
                writer.add_metadata("made", {"by": "variants.py"})
                channels = {}
                for schema, channel, message in read:
                    if channel.id not in channels:
                        of = writer.register_schema(schema.name, schema.encoding, schema.data)
                        channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, of)
                    writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
                writer.finish()
            number += 1
    return number


parser = argparse.ArgumentParser()
parser.add_argument("folder", type=Path)
parser.add_argument("out", type=Path)
parser.add_argument("--frames", type=int)
args = parser.parse_args()
shutil.rmtree(args.out, ignore_errors=True)
for name in ("lossless", "compressed", "options"):
    (args.out / name).mkdir(parents=True)
whole, few = Folder(args.folder, args.frames), Folder(args.folder, 10)
lossless, compressed = args.out / "lossless", args.out / "compressed"
bag(lossless / "plain.bag", whole, "raw")
bag(lossless / "lz4.bag", whole, "raw", Bag.CompressionFormat.LZ4)
data_base(lossless / "sqlite", whole, "raw")
data_base(lossless / "sqlite_messages_zstd", whole, "raw", CompressionMode.MESSAGE)
mcap(lossless / "plain.mcap", whole, "raw", CompressionType.NONE)
mcap(lossless / "lz4.mcap", whole, "raw", CompressionType.LZ4)
bag(compressed / "bz2.bag", whole, "compressed", Bag.CompressionFormat.BZ2)
data_base(compressed / "sqlite_file_zstd", whole, "compressed", CompressionMode.FILE)
mcap(compressed / "zstd.mcap", whole, "compressed", CompressionType.ZSTD)
mcap(args.out / "float.mcap", whole, "float", CompressionType.LZ4)
mcap(args.out / "ten.mcap", few, "raw", CompressionType.NONE)
print(options(args.out / "ten.mcap", args.out / "options"), "files with options")
