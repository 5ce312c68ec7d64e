"""Measures how soon a late reader receives latched messages.

usage: late.py SECONDS_TO_WAIT; a node with dense:=true and a camera must be running
"""
import sys
import time

from cyclonedds.domain import DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from dds_types import *

time.sleep(float(sys.argv[1]))
begin = time.time()
participant = DomainParticipant(0)
latched = qos(latched=True, depth=10)
topics = {"rt/stillpoint/grid": OccupancyGrid, "rt/tf_static": TFMessage, "rt/stillpoint/map": PointCloud2,
          "rt/stillpoint/surface": PointCloud2, "ros_discovery_info": ParticipantEntitiesInfo}
readers = {name: DataReader(participant, Topic(participant, name, type_, qos=latched), qos=latched)
           for name, type_ in topics.items()}
got = {}
while time.time() < begin + 10 and len(got) < len(readers):
    for name, reader in readers.items():
        for sample in reader.take(10):
            if name not in got and hasattr(sample, "__idl__"):
                got[name] = (time.time() - begin, sample)
    time.sleep(0.01)
for name in topics:
    if name not in got:
        print(f"{name}: nothing in 10 s")
        continue
    seconds, sample = got[name]
    if isinstance(sample, OccupancyGrid):
        what = f"{sample.info.width}x{sample.info.height} cells, {sum(c == 100 for c in sample.data)} occupied"
    elif isinstance(sample, PointCloud2):
        what = f"{sample.width} points"
    elif isinstance(sample, TFMessage):
        what = ", ".join(f"{t.header.frame_id} -> {t.child_frame_id}" for t in sample.transforms)
    else:
        what = ", ".join(f"{n.node_namespace} {n.node_name}: {len(n.reader_gid_seq)} readers, {len(n.writer_gid_seq)} writers"
                         for n in sample.node_entities_info_seq)
    print(f"{name}: {seconds:.2f} s, {what}")
