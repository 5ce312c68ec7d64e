"""Computes how much of one surface has nothing of another within 6 cm, and vice versa.

Usage: python compare_meshes.py A.ply B.ply
Needs trimesh, numpy and scipy. Both must have the same frame of reference.
"""

import sys

import numpy as np
import trimesh
from scipy.spatial import cKDTree

REACH = 0.06  # m

names = sys.argv[1:3]
meshes = [trimesh.load(name, process=False) for name in names]
points = [np.concatenate([m.vertices, m.triangles_center]) for m in meshes]
for i, j in ((0, 1), (1, 0)):
    distance, _ = cKDTree(points[j]).query(points[i])
    print(
        f"{names[i]}: {100 * np.mean(distance > REACH):.2f} % of {len(points[i])} points have none of {names[j]} "
        f"within {100 * REACH:.0f} cm; median {1e3 * np.median(distance):.1f} mm"
    )
