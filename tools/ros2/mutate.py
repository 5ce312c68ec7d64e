"""Sends mutated or forged packets to a node: captures packets on loopback while a camera plays, changes them, and sends them again.

usage: mutate.py PID PACKETS SECONDS [KIND]; needs root to listen. Prints memory and threads before and after. KIND, with different numbers in every packet:
  mutated       changed, inserted or removed bytes (default)
  frag          fragments of messages that claim 2 GB
  small_frag    fragments of messages that claim 8 MB
  heartbeat     claims that all messages up to 2^62 exist
  gap           claims that no messages up to 2^62 exist
  empty_frag    empty fragments
  nackfrag      requests for fragment 2^32 - 64
  wide_set      requests for fragments with a set beyond its capacity
  participants  nonexistent participants
"""
import random
import socket
import sys
import time


def status(pid):
    rows = dict(line.split(":", 1) for line in open(f"/proc/{pid}/status") if ":" in line)
    return int(rows["VmRSS"].split()[0]) / 1024, int(rows["VmHWM"].split()[0]) / 1024, int(rows["Threads"])


def capture(seconds, most):
    sniffer = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.ntohs(3))
    sniffer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 16 << 20)
    sniffer.bind(("lo", 0))
    sniffer.settimeout(0.2)
    found, end = [], time.time() + seconds
    while time.time() < end:
        try:
            frame = sniffer.recv(70000)
        except TimeoutError:
            continue
        if frame[23:24] != b"\x11" or frame[12:14] != b"\x08\x00":
            continue
        port = int.from_bytes(frame[36:38], "big")
        body = frame[42:]
        if 7400 <= port <= 7650 and body[:4] == b"RTPS":
            # Most packets are large; small ones are more interesting.
            if len(body) < 5000 or random.random() < 0.02:
                found.append((port, body))
        if len(found) >= most:
            break
    return found


def mutated(body, rng):
    body = bytearray(body)
    for _ in range(rng.choice([1, 1, 2, 4, 16])):
        kind = rng.randrange(6)
        # Most relevant fields are in the first bytes.
        at = rng.randrange(min(len(body), 400)) if rng.random() < 0.8 else rng.randrange(len(body))
        if kind == 0:
            body[at] = rng.randrange(256)
        elif kind == 1:
            body[at:at + 4] = rng.choice([b"\xff\xff\xff\xff", b"\0\0\0\0", b"\xff\xff\xff\x7f", b"\1\0\0\0"])
        elif kind == 2:
            body = body[:max(24, at)]
        elif kind == 3:
            body[at:at] = bytes(rng.randrange(256) for _ in range(rng.choice([1, 4, 64])))
        elif kind == 4:
            body += bytes(rng.choice([1, 100, 20000]))
        else:
            other = rng.randrange(len(body))
            body[at:at + 8] = body[other:other + 8]
    return bytes(body[:65000])


def submessages(body):
    """Kind, byte order, offset and length of each submessage."""
    at = 20
    while at + 4 <= len(body):
        order = "little" if body[at + 1] & 1 else "big"
        length = int.from_bytes(body[at + 2:at + 4], order)
        if length == 0:
            length = len(body) - at - 4
        yield body[at], order, at, length
        at += 4 + length


def sequence_number(value, order):
    return (value >> 32).to_bytes(4, order) + (value & 0xffffffff).to_bytes(4, order)


def fragment(body, number, size):
    for kind, order, at, _ in submessages(body):
        if kind == 0x16:
            body = bytearray(body)
            body[at + 16:at + 24] = sequence_number(2**20 + number, order)
            body[at + 32:at + 36] = size.to_bytes(4, order)
            return bytes(body)
    return None


def alone(body, kind, order, content):
    flags = 1 if order == "little" else 0
    return body[:20] + bytes([kind, flags]) + len(content).to_bytes(2, order) + content


def heartbeat(body, number):
    for kind, order, at, _ in submessages(body):
        if kind == 0x07:
            content = body[at + 4:at + 20] + sequence_number(2**62 + number, order) + (2**20 + number).to_bytes(4, order)
            return alone(body, 0x07, order, content)
    return None


def gap(body, number):
    for kind, order, at, _ in submessages(body):
        if kind == 0x07:
            content = (body[at + 4:at + 12] + sequence_number(2**10 + number, order)
                       + sequence_number(2**62, order) + bytes(4))
            return alone(body, 0x08, order, content)
    return None


def nackfrag(body, number):
    for kind, order, at, _ in submessages(body):
        if kind == 0x06:
            content = (body[at + 4:at + 12] + sequence_number(1 + number, order) + (2**32 - 64).to_bytes(4, order)
                       + (32).to_bytes(4, order) + b"\xff\xff\xff\xff" + (2**20 + number).to_bytes(4, order))
            return alone(body, 0x12, order, content)
    return None


def empty_fragment(body, number):
    for kind, order, at, _ in submessages(body):
        if kind == 0x16:
            body = bytearray(body)
            body[at + 16:at + 24] = sequence_number(2**20 + number, order)
            body[at + 30:at + 32] = bytes(2)
            return bytes(body)
    return None


def wide_set(body, number):
    for kind, order, at, _ in submessages(body):
        if kind == 0x06:
            content = (body[at + 4:at + 12] + sequence_number(1, order) + (1).to_bytes(4, order)
                       + (257).to_bytes(4, order) + b"\xff" * 36 + (2**20 + number).to_bytes(4, order))
            return alone(body, 0x12, order, content)
    return None


def participant(body, number):
    """Announces a nonexistent participant, derived from a real announcement."""
    for kind, _, at, _ in submessages(body):
        if kind == 0x15 and body[at + 12:at + 16] == b"\x00\x01\x00\xc2":
            prefix = body[8:20]
            return body.replace(prefix, prefix[:4] + number.to_bytes(8, "big"))
    return None


FORGERS = {
    "frag": lambda body, i: fragment(body, i, 2**31 - 1),
    "small_frag": lambda body, i: fragment(body, i, 8 << 20),
    "heartbeat": heartbeat,
    "gap": gap,
    "empty_frag": empty_fragment,
    "nackfrag": nackfrag,
    "wide_set": wide_set,
    "participants": participant,
}


def main():
    pid, count, seconds = int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
    kind = sys.argv[4] if len(sys.argv) > 4 else "mutated"
    rng = random.Random(1)
    random.seed(1)
    packets = capture(seconds, 4000)
    print(f"captured {len(packets)} packets; RSS, peak (MB), threads before: {status(pid)}")
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    worst = number = 0
    if kind in FORGERS:
        packets = [(port, body) for port, body in packets if FORGERS[kind](body, 1)]
    if not packets:
        sys.exit(f"{kind}: no packet that could be changed so went by")
    for i in range(count):
        port, body = rng.choice(packets)
        changed = FORGERS[kind](body, i) if kind in FORGERS else mutated(body, rng)
        try:
            out.sendto(changed, ("127.0.0.1", port))
            number += 1
        except OSError:
            pass
        if i % 20 == 0:
            time.sleep(0.01)
        if i % 500 == 0:
            worst = max(worst, status(pid)[0])
    time.sleep(3)
    rss, peak, threads = status(pid)
    print(f"sent {number} packets ({kind}); RSS {rss:.0f} MB, largest {max(worst, rss):.0f}, peak {peak:.0f} MB, threads {threads}")


if __name__ == "__main__":
    main()
