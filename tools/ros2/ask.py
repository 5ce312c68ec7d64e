"""Calls services of the node as rmw_cyclonedds does: ask.py [--namespace /NAME] SERVICE[=true|false]...; for example pause=true save_map reset"""
import sys
import time

from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from dds_types import *

words, namespace = sys.argv[1:], ""
if words[:1] == ["--namespace"]:
    namespace, words = words[1], words[2:]
participant = DomainParticipant(0)
for number, word in enumerate(words, 1):
    name, _, value = word.partition("=")
    ask, answer = (SetBoolRequest, SetBoolResponse) if value else (TriggerRequest, TriggerResponse)
    q = qos(depth=10)
    writer = DataWriter(participant, Topic(participant, f"rq{namespace}/stillpoint/{name}Request", ask, qos=q), qos=q)
    reader = DataReader(participant, Topic(participant, f"rr{namespace}/stillpoint/{name}Reply", answer, qos=q), qos=q)
    end = time.time() + 10
    while time.time() < end and not (writer.get_matched_subscriptions() and reader.get_matched_publications()):
        time.sleep(0.02)
    # The node sees the full id; the answer contains half of it.
    head = CycloneHeader(list(range(1, 9)), 0, number)
    begin = time.time()
    writer.write(ask(head, value == "true") if value else ask(head, 0))
    got = None
    while time.time() < begin + 10 and got is None:
        got = next((s for s in reader.take(5) if hasattr(s, "success") and s.header.low == number), None)
        time.sleep(0.005)
    print(word, "no answer" if got is None else f"{got.success} {got.message!r} in {1e3 * (time.time() - begin):.0f} ms")
