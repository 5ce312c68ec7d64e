"""Fuses dumped frames with Open3D's block grid on the CPU: user time per frame, and the points of the surface.

Usage: OMP_NUM_THREADS=1 python open3d_fuse.py DIR VOXEL [ROUNDS] [POINTS_FILE]
DIR is the output of `lab dense dump-sim|dump-tum`. Needs open3d and numpy.
"""

import os
import sys

import numpy as np
import open3d as o3d
import open3d.core as o3c

folder, voxel = sys.argv[1], float(sys.argv[2])
rounds = int(sys.argv[3]) if len(sys.argv) > 3 else 3
out = sys.argv[4] if len(sys.argv) > 4 else None
device = o3c.Device("CPU:0")
w, h, fx, fy, cx, cy = np.loadtxt(f"{folder}/camera.txt")
w, h = int(w), int(h)
poses = np.loadtxt(f"{folder}/poses.txt").reshape(-1, 4, 4)
intrinsic = o3c.Tensor([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], o3c.float64)
frames = []
for i, pose in enumerate(poses):
    depth = np.fromfile(f"{folder}/{i}.depth", np.uint16).reshape(h, w, 1)
    rgb = np.fromfile(f"{folder}/{i}.rgb", np.uint8).reshape(h, w, 3)
    frames.append(
        (
            o3d.t.geometry.Image(o3c.Tensor(depth)),
            o3d.t.geometry.Image(o3c.Tensor(rgb)),
            o3c.Tensor(np.linalg.inv(pose)),
        )
    )
before = os.times().user
for _ in range(rounds):
    grid = o3d.t.geometry.VoxelBlockGrid(
        ("tsdf", "weight", "color"),
        (o3c.float32, o3c.uint16, o3c.uint16),
        ((1), (1), (3)),
        voxel,
        16,
        40000,
        device,
    )
    for depth, rgb, extrinsic in frames:
        blocks = grid.compute_unique_block_coordinates(depth, intrinsic, extrinsic, 5000.0, 4.0)
        grid.integrate(blocks, depth, rgb, intrinsic, intrinsic, extrinsic, 5000.0, 4.0)
spent = os.times().user - before
print(f"{1e3 * spent / (rounds * len(frames)):.3f} ms of user time per frame ({len(frames)} frames, {rounds} rounds, voxels of {voxel} m)")
if out:
    mesh = grid.extract_triangle_mesh(2.0)
    corners = mesh.vertex.positions.numpy().astype(np.float32)
    triangles = mesh.triangle.indices.numpy()
    middles = corners[triangles].mean(axis=1).astype(np.float32)
    np.concatenate([corners, middles]).tofile(out)
