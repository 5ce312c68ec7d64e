"""Trains a small vocabulary for ORB-SLAM3, in place of ORBvoc.txt: vocabulary.py OUT.txt FOLDER [FOLDER ...].

A k-medians tree over ORB descriptors, in the text format of DBoW2. Do not train it on images that are evaluated.
"""
import sys
from pathlib import Path

import cv2
import numpy as np
from folder import rows

BRANCHES, LEVELS, ITERATIONS = 10, 5, 8
# Total number of images; more have no visible effect on the error.
IMAGES = 120


class Tree:
    def __init__(self, descriptors, image_of, images):
        self.descriptors, self.image_of, self.images = descriptors, image_of, images
        self.bits = np.unpackbits(descriptors, axis=1).astype(np.float32)
        self.random = np.random.default_rng(1)
        self.nodes = []

    def groups(self, members):
        if len(members) <= BRANCHES:
            return [(np.array([m]), self.descriptors[m]) for m in members]
        bits = self.bits[members]
        centres = self.bits[self.random.choice(members, BRANCHES, replace=False)]
        for _ in range(ITERATIONS):
            distances = bits.sum(1)[:, None] + centres.sum(1) - 2 * bits @ centres.T
            nearest = distances.argmin(1)
            for c in np.unique(nearest):
                centres[c] = bits[nearest == c].mean(0) >= 0.5
        return [(members[nearest == c], np.packbits(centres[c].astype(np.uint8))) for c in np.unique(nearest)]

    def grow(self, parent, members, level):
        inner = []
        for group, centre in self.groups(members):
            leaf = level == LEVELS or len(group) == 1
            weight = np.log(self.images / len(np.unique(self.image_of[group]))) if leaf else 0.0
            self.nodes.append(f"{parent} {int(leaf)} {' '.join(map(str, centre))} {weight:.6g}\n")
            if not leaf:
                inner.append((len(self.nodes), group))
        for number, group in inner:
            self.grow(number, group, level + 1)


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    files = [Path(folder) / row[1] for folder in sys.argv[2:] for row in rows(Path(folder) / "rgb.txt")]
    files = files[:: max(1, len(files) // IMAGES)]
    orb = cv2.ORB_create(1000, 1.2, 8)
    found = [orb.detectAndCompute(cv2.imread(str(f), cv2.IMREAD_GRAYSCALE), None)[1] for f in files]
    found = [d for d in found if d is not None]
    tree = Tree(np.vstack(found), np.repeat(np.arange(len(found)), [len(d) for d in found]), len(found))
    tree.grow(0, np.arange(len(tree.descriptors)), 1)
    Path(sys.argv[1]).write_text(f"{BRANCHES} {LEVELS} 0 0 \n" + "".join(tree.nodes))


main()
