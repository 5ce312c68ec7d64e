"""Prints what a Cyclone DDS peer discovers of a node: type hashes announced by its readers and writers, and their owner by `ros_discovery_info`.

usage: discovery.py STILLPOINT_ROS2 [SECONDS]; the node must be running. Hashes are compared with `--types` and with PyPI's ros2_pyterfaces, if
it has the type.
With --count, prints only the number of discovered readers and writers.
"""
import subprocess
import sys
import time

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription
from cyclonedds.core import Policy
from cyclonedds.domain import DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from dds_types import ParticipantEntitiesInfo, qos


def expected_hash(own, type_name):
    package, kind, name = type_name.replace("::dds_", "").split("::")
    name = name[:-1]
    whole = f"{package}/{kind}/{name}"
    from check_hashes import known
    return own.get(whole), known(whole)


def main():
    participant = DomainParticipant(0)
    ends = [(label, BuiltinDataReader(participant, topic))
            for label, topic in (("writer", BuiltinTopicDcpsPublication), ("reader", BuiltinTopicDcpsSubscription))]
    latched = qos(latched=True, depth=1)
    info = DataReader(participant, Topic(participant, "ros_discovery_info", ParticipantEntitiesInfo, qos=latched), qos=latched)
    seconds = [a for a in sys.argv[2:] if not a.startswith("--")]
    time.sleep(float(seconds[0]) if seconds else 3)
    samples = [(label, s) for label, reader in ends for s in reader.take(1000)
               if hasattr(s, "topic_name") and s.topic_name.startswith(("rt/", "rq/", "rr/"))]
    if "--count" in sys.argv:
        print(len(samples))
        return
    own = dict(r.split() for r in subprocess.check_output([sys.argv[1], "--types"], text=True).splitlines())
    bad = compared = 0
    for label, sample in samples:
        data = [p.data for p in sample.qos if isinstance(p, Policy.Userdata)]
        said = data[0].decode() if data else ""
        ours, theirs = expected_hash(own, sample.type_name)
        for expected in (ours, theirs):
            if expected is not None:
                compared += 1
                if said != f"typehash={expected};":
                    bad += 1
                    print("DIFFERENT:", label, sample.topic_name, said, expected)
        if not said:
            bad += 1
            print("no hash:", label, sample.topic_name)
    print(f"{len(samples)} readers and writers, {compared} hashes compared")
    keys = {label: {s.key.bytes for lbl, s in samples if lbl == label} for label in ("writer", "reader")}
    listed = {"writer": set(), "reader": set()}
    for message in info.take(10):
        for node in message.node_entities_info_seq:
            print(f"node {node.node_namespace} {node.node_name}: {len(node.reader_gid_seq)} readers, {len(node.writer_gid_seq)} writers")
            listed["reader"] |= {bytes(g.data) for g in node.reader_gid_seq}
            listed["writer"] |= {bytes(g.data) for g in node.writer_gid_seq}
    for label in listed:
        if listed[label] != keys[label]:
            bad += 1
            print(f"DIFFERENT: {label}s that are announced and those in ros_discovery_info: {len(keys[label] ^ listed[label])}")
    print(f"{bad} different")
    sys.exit(bool(bad))


if __name__ == "__main__":
    main()
