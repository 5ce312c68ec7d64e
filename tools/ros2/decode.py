"""Decodes every message of a recording of the node with PyPI's rosbags, by its definitions of ROS 2 Jazzy, and encodes each again; the bytes must be equal.

usage: decode.py RUN.mcap
"""
import pathlib
import sys
from collections import Counter

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

store = get_typestore(Stores.ROS2_JAZZY)
known = set(store.types)
seen, same, other = Counter(), Counter(), Counter()
with AnyReader([pathlib.Path(sys.argv[1])], default_typestore=store) as reader:
    for connection, _, data in reader.messages():
        name = connection.msgtype
        if name not in store.types:
            store.register(get_types_from_msg(connection.msgdef.data, name))
        message = store.deserialize_cdr(data, name)
        again = bytes(store.serialize_cdr(message, name))
        seen[connection.topic, name] += 1
        # Ignores trailing padding.
        (same if again.rstrip(b"\0") == bytes(data).rstrip(b"\0") else other)[connection.topic] += 1
for (topic, name), count in sorted(seen.items()):
    source = "" if name in known else " (by the recording's own definition)"
    print(f"{topic} {name}{source}: {count} messages, {same[topic]} equal, {other[topic]} not")
sys.exit(bool(other))
