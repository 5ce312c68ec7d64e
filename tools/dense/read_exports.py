"""Opens exports of a dense map with other software: trimesh for meshes, nav2's rules for the plan, OctoMap for the tree.

Usage: python read_exports.py mesh.ply mesh.glb grid.yaml tree.bt
Needs trimesh, numpy, pyyaml and pillow, and octomap-python if it can be installed.
"""

import sys

import numpy as np
import trimesh
import yaml
from PIL import Image

ply, glb, plan, tree = sys.argv[1:5]
for path in (ply, glb):
    mesh = trimesh.load(path, process=False, force="mesh")
    normals = np.linalg.norm(mesh.vertex_normals, axis=1)
    edges, counts = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
    print(
        f"{path}: {len(mesh.vertices)} corners, {len(mesh.faces)} triangles, "
        f"area {mesh.area:.2f} m2, {np.mean(counts > 2):.6f} of the edges in more than two triangles, "
        f"unit normals {np.allclose(normals, 1, atol=1e-3)}, colours {mesh.visual.kind}"
    )

# As nav2_map_server/src/map_io.cpp does in the mode trinary.
with open(plan) as f:
    meta = yaml.safe_load(f)
image = np.asarray(Image.open(plan.rsplit("/", 1)[0] + "/" + meta["image"] if "/" in plan else meta["image"])).astype(float)
shade = image / 255.0
occupancy = shade if meta["negate"] else 1.0 - shade
state = np.full(image.shape, -1)
state[occupancy >= meta["occupied_thresh"]] = 100
state[occupancy <= meta["free_thresh"]] = 0
h, w = state.shape
print(
    f"{plan}: {w} x {h} cells of {meta['resolution']} m from {meta['origin']}: "
    f"{(state == 100).sum()} occupied, {(state == 0).sum()} free, {(state == -1).sum()} unknown"
)
try:
    import octomap
except ImportError:
    print("octomap-python is not installed")
else:
    octree = octomap.OcTree(tree.encode())
    print(f"{tree}: resolution {octree.getResolution()}, {octree.size()} nodes, {octree.getNumLeafNodes()} leaves")
