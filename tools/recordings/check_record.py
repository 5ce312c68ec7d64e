"""Reads a file written by `stillpoint run ... --record` with other projects' libraries.

    check_record.py RUN.mcap RESULT

Every message is decoded by `mcap-ros2-support` (by the file's definitions) and by `rosbags` (by those of ROS 2 Humble, or the file's if Humble has none); both
must give the same values. The transforms map -> odom -> camera_link -> camera_color_optical_frame, without the constant rotation, are then compared with
RESULT/trajectory_online.txt, to the last digit. Exit code 1 if anything differs.
"""

import sys
from collections import Counter

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_types_from_msg, get_typestore


def product(a, b):
    """The product of two quaternions w, x, y, z."""
    (w, x, y, z), (p, q, r, s) = a, b
    return np.array([w * p - x * q - y * r - z * s, w * q + x * p + y * s - z * r, w * r - x * s + y * p + z * q, w * s + x * r - y * q + z * p])


def rotate(q, v):
    conjugate = np.array([q[0], -q[1], -q[2], -q[3]])
    return product(product(q, np.array([0.0, *v])), conjugate)[1:]


def pose(transform):
    t, r = transform.translation, transform.rotation
    return np.array([r.w, r.x, r.y, r.z]), np.array([t.x, t.y, t.z])


def chain(a, b):
    return product(a[0], b[0]), a[1] + rotate(a[0], b[1])


def same(a, b):
    """Whether two decoded messages of different classes have equal values."""
    if isinstance(a, bytes):
        return a == bytes(b)
    if isinstance(a, (str, bool, int)):
        return a == b
    if isinstance(a, float):
        return a == b or (a != a and b != b) or np.float32(a) == np.float32(b)
    if isinstance(b, np.ndarray):
        return np.array_equal(np.asarray(a), b)
    if isinstance(a, (list, tuple)):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b))
    names = [n for n in a.__slots__] if hasattr(a, "__slots__") else [n for n in vars(a)]
    return all(same(getattr(a, n), getattr(b, n)) for n in names)


def main(path, result):
    store = get_typestore(Stores.ROS2_HUMBLE)
    factory = DecoderFactory()
    counts, different, chains, constant = Counter(), Counter(), [], None
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            ours = factory.decoder_for(channel.message_encoding, schema)(message.data)
            if schema.name not in store.fielddefs:
                store.register(get_types_from_msg(schema.data.decode(), schema.name))
            theirs = store.deserialize_cdr(message.data, schema.name)
            counts[channel.topic] += 1
            different[channel.topic] += not same(ours, theirs)
            if channel.topic == "/tf_static" and constant is None:
                constant = pose(ours.transforms[0].transform)
            if channel.topic == "/tf":
                first, second = ours.transforms
                stamp = first.header.stamp.sec + first.header.stamp.nanosec * 1e-9
                chains.append((stamp, chain(pose(first.transform), pose(second.transform))))
    undo = np.array([constant[0][0], *(-constant[0][1:])])
    lines = []
    for stamp, body in chains:
        q, t = chain(body, constant)
        # The world's frame is rotated like the camera's: apply the same rotation again.
        q, t = product(undo, q), rotate(undo, t)
        q = q if q[0] >= 0 else -q
        numbers = [*t, q[1], q[2], q[3], q[0]]
        lines.append(f"{stamp:.6f} " + " ".join(f"{x:.9f}" for x in numbers))
    with open(f"{result}/trajectory_online.txt") as file:
        expected = [line.strip() for line in file if not line.startswith("#")]

    def digits(line):
        return [x if float(x) else "0.000000000" for x in line.replace("-0.000000000", "0.000000000").split()]

    off = sum(digits(a) != digits(b) for a, b in zip(lines, expected)) + abs(len(lines) - len(expected))
    for topic, count in sorted(counts.items()):
        print(f"{count:6} {topic}" + (f": {different[topic]} DIFFER" if different[topic] else ""))
    print(f"{len(expected)} poses, of which {off} differ from trajectory_online.txt")
    return 1 if off or sum(different.values()) else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:3]))
