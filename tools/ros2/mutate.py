"""Sends mutated packets to a node: takes what goes over loopback while a camera is played, changes it, and sends it again.

usage: mutate.py PID PACKETS SECONDS [frag]; needs root to listen; frag: fragments that say that their message has 2 GB, new ones each time. Prints memory and threads before and after.
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
            # Large ones are most of what goes by; small ones are the more interesting.
            if len(body) < 5000 or random.random() < 0.02:
                found.append((port, body))
        if len(found) >= most:
            break
    return found


def mutated(body, rng):
    body = bytearray(body)
    for _ in range(rng.choice([1, 1, 2, 4, 16])):
        kind = rng.randrange(6)
        # Most of what matters is in the first bytes.
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


def oversized(body, number):
    """A fragment (submessage 0x16) with another number and a size of 2 GB; none of other packets."""
    at = 20
    while at + 4 <= len(body):
        kind, flags, length = body[at], body[at + 1], int.from_bytes(body[at + 2:at + 4], "little")
        if kind == 0x16:
            body = bytearray(body)
            body[at + 20:at + 24] = (2**20 + number).to_bytes(4, "little")
            body[at + 32:at + 36] = (2**31 - 1).to_bytes(4, "little")
            return bytes(body)
        if length == 0:
            return None
        at += 4 + length
    return None


def main():
    pid, count, seconds = int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
    frag = len(sys.argv) > 4
    rng = random.Random(1)
    random.seed(1)
    packets = capture(seconds, 4000)
    print(f"captured {len(packets)} packets; RSS, peak (MB), threads before: {status(pid)}")
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    worst = 0
    for i in range(count):
        port, body = rng.choice(packets)
        try:
            sent = oversized(body, i) if frag else mutated(body, rng)
            if sent:
                out.sendto(sent, ("127.0.0.1", port))
        except OSError:
            pass
        if i % 20 == 0:
            time.sleep(0.01)
        if i % 500 == 0:
            worst = max(worst, status(pid)[0])
    time.sleep(3)
    rss, peak, threads = status(pid)
    print(f"sent {count} mutated packets; RSS {rss:.0f} MB, largest {max(worst, rss):.0f}, peak {peak:.0f} MB, threads {threads}")


if __name__ == "__main__":
    main()
