"""Plays a TUM folder to the node as a camera on Cyclone DDS, in real time, and stores the node's output.

usage: play.py FOLDER OUT.json [--reliable] [--frames N] [--loops N] [--rate X] [--tf] [--half] [--compressed] [--namespace /NAME] [--shift S]...
OUT.json: odometry (stamp, position, quaternion, times of sending and arrival), tf, counts.
"""
import argparse
import json
import pathlib
import struct
import time
import tomllib
from collections import Counter

import cv2
import numpy as np
from cyclonedds._clayer import ddspy_write
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from dds_types import *

FR1 = dict(fx=517.306408, fy=516.469215, cx=318.643040, cy=255.313989,
           d=[0.262383, -0.953104, -0.005358, 0.002628, 1.163314])


def listed(folder, name):
    rows = (line.split() for line in (folder / name).read_text().splitlines() if line and not line.startswith("#"))
    return [(float(stamp), folder / file) for stamp, file in rows]


def pairs(folder, most):
    colour, depth = listed(folder, "rgb.txt"), listed(folder, "depth.txt")
    near = sorted((abs(c[0] - d[0]), i, j) for i, c in enumerate(colour) for j, d in enumerate(depth)
                  if abs(c[0] - d[0]) < 0.02)
    partner, taken = {}, set()
    for _, i, j in near:
        if i not in partner and j not in taken:
            partner[i] = j
            taken.add(j)
    found = [(colour[i][0], colour[i][1], *depth[j]) for i, j in sorted(partner.items())]
    return found[:most]


def at(stamp):
    ns = round(stamp * 1e6) * 1000
    return Time(ns // 10**9, ns % 10**9)


def image_bytes(frame, h, w, encoding, step, data):
    """A sensor_msgs/Image with a stamp of zero. The serialiser of PyPI's cyclonedds takes some 30 ms for it."""
    out = bytearray(b"\0\1\0\0" + bytes(8))

    def number(n):
        out.extend(bytes(-len(out) % 4))
        out.extend(struct.pack("<I", n))

    def text(t):
        number(len(t) + 1)
        out.extend(t.encode() + b"\0")

    text(frame)
    number(h)
    number(w)
    text(encoding)
    out.append(0)
    number(step)
    number(len(data))
    out.extend(data)
    out.extend(bytes(-len(out) % 4))
    return bytes(out)


def compressed_bytes(frame, format_, data):
    """A sensor_msgs/CompressedImage with a stamp of zero."""
    out = bytearray(b"\0\1\0\0" + bytes(8))
    for text in (frame, format_):
        out.extend(bytes(-len(out) % 4))
        out.extend(struct.pack("<I", len(text) + 1) + text.encode() + b"\0")
    out.extend(bytes(-len(out) % 4))
    out.extend(struct.pack("<I", len(data)) + data)
    out.extend(bytes(-len(out) % 4))
    return bytes(out)


def send_image(writer, message, stamp):
    body = message[:4] + struct.pack("<iI", stamp.sec, stamp.nanosec) + message[12:]
    assert ddspy_write(writer._ref, body) >= 0


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--reliable", action="store_true")
    parser.add_argument("--frames", type=int, default=10**9)
    parser.add_argument("--loops", type=int, default=1)
    parser.add_argument("--domain", type=int, default=0)
    parser.add_argument("--tf", action="store_true")
    parser.add_argument("--rate", type=float, default=1.0)
    parser.add_argument("--namespace", default="")
    parser.add_argument("--objects", action="store_true", help="listens to objects, too")
    parser.add_argument("--own-tf", action="store_true", help="transforms in the namespace, too")
    parser.add_argument("--no-info", action="store_true")
    parser.add_argument("--half", action="store_true", help="images of half the width and height")
    parser.add_argument("--compressed", action="store_true", help="colour as JPEG on .../compressed, depth as PNG on .../compressedDepth")
    parser.add_argument("--encoding", default="rgb8")
    parser.add_argument("--shift", type=float, default=0.0, help="added to all stamps, s")
    args = parser.parse_args()
    frames = pairs(args.folder, args.frames)
    if (args.folder / "camera.toml").exists():
        c = tomllib.loads((args.folder / "camera.toml").read_text())
        k = dict(fx=c["fx"], fy=c["fy"], cx=c["cx"], cy=c["cy"], d=c.get("distortion", [0.0] * 5))
        scale = c.get("depth_scale", 5000.0)
    elif (args.folder / "camera.txt").exists():
        fx, fy, cx, cy, scale = map(float, (args.folder / "camera.txt").read_text().split()[:5])
        k = dict(fx=fx, fy=fy, cx=cx, cy=cy, d=[0.0] * 5)
    else:
        k, scale = FR1, 5000.0
    if args.half:
        k = dict(k, fx=k["fx"] / 2, fy=k["fy"] / 2, cx=k["cx"] / 2 - 0.25, cy=k["cy"] / 2 - 0.25)
    images = []
    for stamp, colour, depth_stamp, depth in frames:
        bgr = cv2.imread(str(colour))
        mm = np.rint(cv2.imread(str(depth), cv2.IMREAD_UNCHANGED).astype(np.float64) * (1000.0 / scale)).astype("<u2")
        if args.half:
            bgr = cv2.resize(bgr, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
            mm = np.ascontiguousarray(mm[::2, ::2])
        rgb = cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)
        h, w = bgr.shape[:2]
        frame = "camera_color_optical_frame"
        if args.compressed:
            jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
            # The header of compressed_depth_image_transport before the PNG: a format, and two numbers for depth in metres.
            png = bytes(12) + cv2.imencode(".png", mm)[1].tobytes()
            colour_image = compressed_bytes(frame, "rgb8; jpeg compressed bgr8", jpeg)
            depth_image = compressed_bytes(frame, "16UC1; compressedDepth png", png)
        else:
            colour_image = image_bytes(frame, h, w, args.encoding, w * 3, rgb.tobytes())
            depth_image = image_bytes(frame, h, w, "16UC1", w * 2, mm.tobytes())
        images.append((stamp + args.shift, colour_image, depth_stamp + args.shift, depth_image, (h, w)))
    participant = DomainParticipant(args.domain)
    sensor = qos(reliable=args.reliable, depth=5)

    def writer(name, type_, q=None):
        q = q or sensor
        return DataWriter(participant, Topic(participant, name, type_, qos=q), qos=q)

    def reader(name, type_, q=None):
        q = q or qos()
        return DataReader(participant, Topic(participant, name, type_, qos=q), qos=q)

    base = "rt" + args.namespace
    root = base if args.own_tf else "rt"
    type_ = CompressedImage if args.compressed else Image
    ends = ["/compressed", "/compressedDepth"] if args.compressed else ["", ""]
    colour = writer(base + "/camera/color/image_raw" + ends[0], type_)
    depth = writer(base + "/camera/aligned_depth_to_color/image_raw" + ends[1], type_)
    colour_info = writer(base + "/camera/color/camera_info", CameraInfo)
    depth_info = writer(base + "/camera/aligned_depth_to_color/camera_info", CameraInfo)
    static = writer(root + "/tf_static", TFMessage, qos(latched=True, depth=1)) if args.tf else None
    odometry = reader(base + "/stillpoint/odometry", Odometry)
    tf = reader(root + "/tf", TFMessage)
    objects = reader(base + "/stillpoint/objects", Detection3DArray) if args.objects else None
    diagnostics = reader("rt/diagnostics", DiagnosticArray)
    said = reader("rt/rosout", Log, qos(latched=True))
    if static:
        optical = TransformStamped(Header(at(0), "base_link"), "camera_color_optical_frame",
                                   Transform(Vector3(0.1, 0.0, 0.3), Quaternion(-0.5, 0.5, -0.5, 0.5)))
        static.write(TFMessage([optical]))

    end = time.time() + 20
    while time.time() < end and not (colour.get_matched_subscriptions() and depth.get_matched_subscriptions()
                                     and odometry.get_matched_publications()):
        time.sleep(0.05)
    time.sleep(0.5)
    log = dict(odometry=[], tf=[], sent=0, diagnostics=[], rosout=[], complete={}, objects=[])

    def take():
        now = time.time()
        for sample in odometry.take(100):
            if hasattr(sample, "pose"):
                s, p, q = sample.header.stamp, sample.pose.pose.position, sample.pose.pose.orientation
                log["odometry"].append([s.sec + s.nanosec * 1e-9, p.x, p.y, p.z, q.x, q.y, q.z, q.w, now])
        for sample in tf.take(100):
            if hasattr(sample, "transforms"):
                for t in sample.transforms:
                    s, p, q = t.header.stamp, t.transform.translation, t.transform.rotation
                    log["tf"].append([s.sec + s.nanosec * 1e-9, t.header.frame_id, t.child_frame_id,
                                      p.x, p.y, p.z, q.x, q.y, q.z, q.w])
        for sample in objects.take(100) if objects else []:
            if hasattr(sample, "detections"):
                log["objects"].append([[r.hypothesis.class_id for r in d.results] for d in sample.detections])
        for sample in said.take(100):
            if hasattr(sample, "msg"):
                log["rosout"].append(sample.msg)
        for sample in diagnostics.take(100):
            if hasattr(sample, "status"):
                for status in sample.status:
                    log["diagnostics"].append([status.level, status.name, status.message])

    frame = "camera_color_optical_frame"
    begin = time.time()
    first = images[0][0]
    length = images[-1][0] - first + 1 / 30
    for loop in range(args.loops):
        # Forwards and backwards, so that the camera does not jump.
        order = images if loop % 2 == 0 else images[::-1]
        for i, (stamp, rgb, depth_stamp, mm, (h, w)) in enumerate(order):
            if loop % 2 == 1:
                stamp, depth_stamp = (first + length - 1 / 30 - (s - first) for s in (stamp, depth_stamp))
            stamp, depth_stamp = stamp + loop * length, depth_stamp + loop * length
            due = begin + (stamp - first) / args.rate
            while time.time() < due:
                take()
                time.sleep(max(0.0, min(0.001, due - time.time())))
            head = Header(at(stamp), frame)
            if not args.no_info:
                f = k
                matrix = [f["fx"], 0.0, f["cx"], 0.0, f["fy"], f["cy"], 0.0, 0.0, 1.0]
                info = CameraInfo(head, h, w, "plumb_bob", f["d"], matrix, [1.0, 0, 0, 0, 1, 0, 0, 0, 1],
                                  [f["fx"], 0.0, f["cx"], 0.0, 0.0, f["fy"], f["cy"], 0.0, 0.0, 0.0, 1.0, 0.0], 0, 0,
                                  RegionOfInterest(0, 0, 0, 0, False))
                colour_info.write(info)
                depth_info.write(info)
            send_image(colour, rgb, at(stamp))
            send_image(depth, mm, at(depth_stamp))
            log["complete"][f"{stamp:.6f}"] = time.time()
            log["sent"] += 1
    end = time.time() + 2
    while time.time() < end:
        take()
        time.sleep(0.005)
    log["seconds"] = time.time() - begin
    args.out.write_text(json.dumps(log))
    late = [o[8] - log["complete"][f"{o[0]:.6f}"] for o in log["odometry"] if f"{o[0]:.6f}" in log["complete"]]
    if objects:
        classes = Counter(c for frame in log["objects"] for d in frame for c in d)
        print(f"{len(log['objects'])} messages of objects, {sum(map(bool, log['objects']))} with some: {dict(classes)}")
    print(f"sent {log['sent']}, odometry {len(log['odometry'])}, tf {len(log['tf'])}, "
          f"latency median {1e3 * np.median(late or [0]):.1f} ms, p95 {1e3 * np.percentile(late or [0], 95):.1f} ms")


if __name__ == "__main__":
    main()
