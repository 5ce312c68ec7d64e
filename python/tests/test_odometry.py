"""Wheel odometry and pose priors."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import stillpoint_slam as sp

# Mount of the simulator's camera: looking ahead, 0.2 m in front of the axle and 0.5 m above it.
MOUNT = np.array([[0.0, 0, 1, 0.2], [-1, 0, 0, 0], [0, -1, 0, 0.5], [0, 0, 0, 1]])


def test_odometry_is_used_and_reported() -> None:
    room = sp.simulate("xyz", frames=40, odometry=True)
    assert room.has_odometry and not sp.simulate("xyz", frames=3).has_odometry
    with sp.Slam(room.camera, odometry=True) as slam:
        for image in room:
            assert image.odometry.shape[1] == 10 and len(image.odometry) > 0
            assert np.isnan(image.odometry[:, 8:]).all()
            frame = slam.track(image.stamp, image.color, image.depth, depth_stamp=image.depth_stamp, odometry=image.odometry)
    known = frame.odometry
    assert known is not None and known["state"] == "confirmed" and known["reason"] is None
    assert known["samples"] > 60 and known["slips"] == 0
    poses = slam.trajectory().poses
    assert np.array_equal(sp.run(room, progress=False).trajectory.poses, poses)
    # A mount as a matrix, and samples without deviations, give the same poses.
    for mount in (MOUNT, {"base_from_camera": MOUNT.tolist(), "slip_per_metre": 0.02}):
        with sp.Slam(room.camera, odometry=mount) as slam:
            for image in room:
                slam.track(image.stamp, image.color, image.depth, depth_stamp=image.depth_stamp, odometry=image.odometry[:, :8].tolist())
        assert np.allclose(slam.trajectory().poses, poses, atol=1e-5)
    with sp.Slam(room.camera) as slam:
        first = room[0]
        assert slam.track(first.stamp, first.color, first.depth).odometry is None


def test_folders_and_files_provide_odometry(tmp_path: Path) -> None:
    folder, file = tmp_path / "room", tmp_path / "room.mcap"
    line = [sys.executable, "-m", "stillpoint_slam"]
    subprocess.run([*line, "-q", "simulate", "--scene", "xyz", "--frames", "10", "--odometry", "--out", folder], check=True)
    subprocess.run([*line, "-q", "recording", "convert", folder, file], check=True)
    texts = []
    for path in (folder, file):
        recording = sp.open(path)
        assert recording.has_odometry and sum(len(image.odometry) for image in recording) > 15
        texts.append(sp.run(recording, progress=False).trajectory.to_tum())
    assert texts[0] == texts[1]


def test_live_runs_accept_odometry_and_prior_poses() -> None:
    room = sp.simulate("xyz", frames=20, odometry=True)
    with sp.Slam(room.camera, live=True, odometry=True) as wheels, sp.Slam(room.camera, live=True, prior=True) as own:
        for image in room:
            images = image.stamp, image.gray, image.depth
            frame = wheels.track(*images, odometry=image.odometry)
            known = own.track(*images, prior=image.truth).odometry
    assert frame.odometry is not None and frame.odometry["samples"] > 30
    assert known is not None and known["samples"] == 20


def test_odometry_with_a_wrong_mount_is_ignored() -> None:
    room = sp.simulate("halfsphere", frames=90, odometry=True)
    turned = MOUNT @ np.array([[0.0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]])
    with sp.Slam(room.camera, odometry=turned) as slam:
        for image in room:
            frame = slam.track(image.stamp, image.color, image.depth, depth_stamp=image.depth_stamp, odometry=image.odometry)
    assert frame.odometry is not None and frame.odometry["state"] == "ignored" and "base_from_camera" in frame.odometry["reason"]


def off(room: sp.Simulation, poses: list[np.ndarray | None]) -> float:
    """Error of the last pose relative to the first, m; infinite without a pose."""
    truth = [np.asarray(p) for p in room.truth.poses]
    if poses[0] is None or poses[-1] is None:
        return float("inf")
    found, exact = np.linalg.inv(poses[0]) @ poses[-1], np.linalg.inv(truth[0]) @ truth[-1]
    return float(np.linalg.norm(found[:3, 3] - exact[:3, 3]))


def test_prior_poses_bridge_a_blocked_view() -> None:
    room = sp.simulate("blocked_walk", frames=140, rate=20.0)
    # A different frame of reference: z up, and far away.
    own = np.array([[0.0, 0, 1, 7], [-1, 0, 0, -3], [0, -1, 0, 2], [0, 0, 0, 1]])
    covariance = np.diag([1e-6] * 3 + [1e-7] * 3)
    runs: dict[str, tuple[float, list[str]]] = {}
    for how in ("with", "without"):
        figures = None if how == "without" else {"slip_per_metre": 0.005}
        poses, states = [], []
        with sp.Slam(room.camera, prior=figures) as slam:
            for image in room:
                prior = None if how == "without" else (own @ image.truth, covariance)
                frame = slam.track(image.stamp, image.gray, image.depth, depth_stamp=image.depth_stamp, prior=prior)
                poses.append(frame.pose)
                states.append(frame.state)
        runs[how] = off(room, poses), states
        assert (frame.odometry is None) == (how == "without")
    assert runs["with"][0] < 0.06 and "carried" in runs["with"][1] and "lost" not in runs["with"][1], runs["with"][0]
    assert runs["without"][0] > 0.2 or runs["without"][1].count("lost") > 5, runs["without"][0]


def test_invalid_odometry_is_refused_with_a_reason() -> None:
    room = sp.simulate("xyz", frames=2, odometry=True)
    image = room[0]
    with pytest.raises(ValueError, match=r"odometry: expected a camera of a file with a table \[odometry\]"):
        sp.Slam(sp.Camera.preset("tum_fr1"), odometry=True)
    for bad, words in [
        (np.zeros((4, 4)), "expected True, or how the camera stands"),
        ({"slip_per_metre": 0.1}, "no base_from_camera"),
        ({"base_from_camera": MOUNT, "slip": 0.1}, "found \"slip\""),
        ({"base_from_camera": MOUNT, "slip_per_metre": 0.0}, "slip_per_metre: expected a number"),
    ]:
        with pytest.raises(ValueError, match=f"odometry: .*{words}"):
            sp.Slam(room.camera, odometry=bad)
    with pytest.raises(TypeError, match="odometry: expected True, or how the camera stands"):
        sp.Slam(room.camera, odometry="wheels")
    with pytest.raises(ValueError, match="prior: expected keys of slip_per_metre"):
        sp.Slam(room.camera, prior={"time_offset": 0.1})
    with pytest.raises(TypeError, match="prior: expected True, or a dict"):
        sp.Slam(room.camera, prior=0.1)
    with pytest.raises(ValueError, match="prior: expected odometry of a base or poses of the camera, found both"):
        sp.Slam(room.camera, odometry=True, prior=True)
    images = image.stamp, image.color, image.depth
    row = [0.0, 0, 0, 0, 0, 0, 0, 1]
    plain, wheels, own = sp.Slam(room.camera), sp.Slam(room.camera, odometry=True), sp.Slam(room.camera, prior=True)
    for slam in (plain, own):
        with pytest.raises(ValueError, match=r"begin with Slam\(\.\.\., odometry=base_from_camera\)"):
            slam.track(*images, odometry=[row])
    for slam in (plain, wheels):
        with pytest.raises(ValueError, match=r"begin with Slam\(\.\.\., prior=True\)"):
            slam.track(*images, prior=np.eye(4))
    for bad, words in [
        ([row[:7]], "shape"),
        ([row, row], "row 1"),
        ([[0.0] * 8], "row 0"),
        ([[*row, -0.1, 0.1]], "row 0"),
        ([[*row, np.nan, 0.1]], "row 0"),
    ]:
        with pytest.raises(ValueError, match=f"odometry: expected an array of N x 8.*{words}"):
            wheels.track(*images, odometry=bad)
    for bad, words in [
        (np.eye(3), "shape"),
        (2 * np.eye(4), "no rotation"),
        ((np.eye(4), np.eye(3)), "covariance with the shape"),
        ((np.eye(4), -np.eye(6)), "variance of -1"),
        ((np.eye(4), np.nan * np.eye(6)), "variance of NaN"),
    ]:
        with pytest.raises(ValueError, match=f"prior: expected the pose of the camera.*{words}"):
            own.track(*images, prior=bad)
    assert wheels.track(*images, odometry=np.zeros((0, 8))).is_tracked
    assert own.track(*images, prior=(np.eye(4), None)).is_tracked
