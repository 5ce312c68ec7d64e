"""Checks odom for jumps: compares its steps with those of the map, and at changes of map -> odom.

usage: jumps.py HEARD.json [GROUNDTRUTH.txt]
"""
import json
import sys

import numpy as np

heard = json.load(open(sys.argv[1]))
at = {}
for t in heard["tf"]:
    at.setdefault(round(t[0], 6), {})[t[1] + ">" + t[2]] = np.array(t[3:6])
stamps = sorted(at)
odom = [(s, next(p for k, p in at[s].items() if k.startswith("odom>"))) for s in stamps]
moved = [(s, at[s]["map>odom"]) for s in stamps if "map>odom" in at[s]]
changes = [(b[0], np.linalg.norm(b[1] - a[1])) for a, b in zip(moved, moved[1:]) if np.linalg.norm(b[1] - a[1]) > 1e-6]
print(f"{len(odom)} poses; map -> odom changes {len(changes)} times, by up to {1e3 * max((c[1] for c in changes), default=0):.1f} mm")
if len(sys.argv) > 2:
    rows = [list(map(float, r.split()[:4])) for r in open(sys.argv[2]) if not r.startswith("#")]
    truth = np.array(rows)
    first, last = truth[0, 0], truth[-1, 0]
    length = last - first + 1 / 30

    def where(s):
        # Forwards and backwards, as with play.py --loops.
        turn, s = divmod(s - first, length)
        s = s if turn % 2 == 0 else length - 1 / 30 - s
        return np.array([np.interp(first + s, truth[:, 0], truth[:, k]) for k in (1, 2, 3)])

    excess = [np.linalg.norm(b[1] - a[1]) - np.linalg.norm(where(b[0]) - where(a[0])) for a, b in zip(odom, odom[1:])]
    print(f"odom's step exceeds the true motion by {1e3 * max(excess):.1f} mm at most (95 %: {1e3 * np.percentile(excess, 95):.1f} mm)")
    by = {c[0] for c in changes}
    at_changes = [e for e, b in zip(excess, odom[1:]) if b[0] in by]
    if at_changes:
        print(f"... where map -> odom changes: {1e3 * max(at_changes):.1f} mm")
