"""SLAM frame by frame: frames, maps, map files, events, live runs."""

from __future__ import annotations

import gc
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

import stillpoint_slam as sp


def run(slam: sp.Slam, images: list[sp.RgbdFrame]) -> list[sp.Frame]:
    frames = [slam.track(i.stamp, i.color, i.depth, depth_stamp=i.depth_stamp) for i in images]
    slam.finish()
    return frames


def test_frame_reports_its_tracking_result(room: sp.Simulation, images: list[sp.RgbdFrame]) -> None:
    frames = run(sp.Slam(room.camera), images)
    assert [f.index for f in frames] == list(range(12))
    assert frames[0].state == "initialised" and frames[0].covariance is None
    last = frames[-1]
    assert last.state == "tracked" and last.is_tracked and last.reason is None
    assert last.pose.shape == (4, 4) and last.pose.dtype == np.float64
    assert np.allclose(last.pose[:3, :3] @ last.pose[:3, :3].T, np.eye(3))
    assert np.allclose(last.position, last.pose[:3, 3])
    assert np.isclose(np.linalg.norm(last.quaternion), 1.0) and last.quaternion[3] >= 0
    assert last.covariance.shape == (6, 6) and np.allclose(last.covariance, last.covariance.T)
    assert 0.5 < last.health.quality <= 1.0 and last.health.loss is None
    assert last.inliers == last.counts["inliers"] > 100
    v = last.verdicts
    assert v.pixels.shape == (len(v), 2) and v.dynamic.shape == v.risk.shape == (len(v),) and len(v.reasons) == len(v)
    assert last.mask.shape == (480, 640) and set(np.unique(last.mask)) <= {0, 255}
    assert np.array_equal(last.gray, images[-1].gray) and np.array_equal(last.depth, images[-1].depth)
    # The simulator's ground truth, relative to the first frame.
    truth = np.linalg.inv(images[0].truth) @ images[-1].truth
    off = np.linalg.inv(frames[0].pose) @ last.pose @ np.linalg.inv(truth)
    assert np.linalg.norm(off[:3, 3]) < 0.005


def test_runs_are_deterministic(room: sp.Simulation, images: list[sp.RgbdFrame]) -> None:
    texts = []
    for _ in range(2):
        slam = sp.Slam(room.camera)
        run(slam, images)
        texts.append(slam.trajectory().to_tum())
    assert texts[0] == texts[1]
    other = sp.Slam(room.camera, {"features.features": 500})
    run(other, images)
    assert other.trajectory().to_tum() != texts[0]


def test_image_formats_give_the_same_trajectory(room: sp.Simulation, images: list[sp.RgbdFrame]) -> None:
    def text(slam: sp.Slam, color: object, depth: object) -> str:
        for i in images:
            slam.track(i.stamp, color(i), depth(i), depth_stamp=i.depth_stamp)
        slam.finish()
        return slam.trajectory().to_tum()

    def raw(i: sp.RgbdFrame) -> np.ndarray:
        return np.rint(i.depth.astype(np.float64) * 5000).astype(np.uint16)

    def metres(i: sp.RgbdFrame) -> np.ndarray:
        return (raw(i).astype(np.float64) / 5000).astype(np.float32)

    reference = text(sp.Slam(room.camera), lambda i: i.color, metres)
    assert text(sp.Slam(room.camera), lambda i: i.gray, raw) == reference
    bgr = sp.Slam(room.camera, color_order="bgr")
    assert text(bgr, lambda i: i.color[..., ::-1], lambda i: metres(i).astype(np.float64)) == reference
    # Control: the wrong order gives another result.
    assert text(sp.Slam(room.camera), lambda i: i.color[..., ::-1], metres) != reference


def test_array_views_are_shared_and_read_only(room: sp.Simulation, images: list[sp.RgbdFrame]) -> None:
    frame = sp.Slam(room.camera).track(0.0, images[0].color, images[0].depth)
    gray = frame.gray
    assert np.shares_memory(gray, frame.gray)
    with pytest.raises(ValueError):
        gray[0, 0] = 1
    with pytest.raises(ValueError):
        gray.flags.writeable = True
    before = gray.copy()
    del frame
    gc.collect()
    assert np.array_equal(gray, before)
    assert frame_color_is_kept_only_where_wanted(room, images)


def frame_color_is_kept_only_where_wanted(room: sp.Simulation, images: list[sp.RgbdFrame]) -> bool:
    i = images[0]
    plain = sp.Slam(room.camera).track(i.stamp, i.color, i.depth)
    asked = sp.Slam(room.camera, detector=lambda image: []).track(i.stamp, i.color, i.depth)
    return plain.color is None and np.array_equal(asked.color, i.color)


def test_map_snapshots_are_immutable(room: sp.Simulation, images: list[sp.RgbdFrame]) -> None:
    slam = sp.Slam(room.camera)
    first = slam.track(images[0].stamp, images[0].color, images[0].depth)
    early = slam.map
    points = len(early.points)
    run(slam, images[1:])
    assert first.is_keyframe and early.version <= slam.map.version and len(early.points) == points
    late = slam.map
    assert late.points.shape == (len(late.point_ids), 3) == (len(late.observers), 3)
    assert late.keyframe_poses.shape == (len(late.keyframe_ids), 4, 4) and len(late.keyframes) == len(late.keyframe_ids)
    assert late.covisibility.shape[1] == 3 and late.loops.shape[1] == 2 and len(late.submaps) == len(late.keyframe_ids)


def test_maps_are_saved_loaded_and_localized_in(room: sp.Simulation, images: list[sp.RgbdFrame], tmp_path: Path) -> None:
    slam = sp.Slam(room.camera)
    run(slam, images)
    path = tmp_path / "room.spmap"
    slam.save(path)
    for begin in (sp.Slam.load, sp.Slam.localize):
        again = begin(path, room.camera)
        frames = run(again, images)
        assert frames[-1].state == "tracked"
        assert any(f.state == "relocalised" for f in frames)
        assert np.allclose(frames[-1].pose[:3, 3], slam.trajectory().positions[-1], atol=0.02)
    with pytest.raises(ValueError, match="path: .*camera"):
        sp.Slam.load(path, "tum_fr1")
    with pytest.raises(FileNotFoundError, match="path"):
        sp.Slam.load(tmp_path / "none.spmap", room.camera)
    (tmp_path / "bad.spmap").write_bytes(b"no map")
    with pytest.raises(ValueError, match="path"):
        sp.Slam.localize(tmp_path / "bad.spmap", room.camera)
    with pytest.raises(ValueError, match="path"):
        sp.Slam(room.camera).save(tmp_path / "empty.spmap")
    assert not (tmp_path / "empty.spmap").exists()


def test_events_are_ordered_and_bounded(room: sp.Simulation, images: list[sp.RgbdFrame]) -> None:
    slam = sp.Slam(room.camera)
    events, few = slam.events(), slam.events(room=2)
    slam.track(images[0].stamp, images[0].color, images[0].depth)
    first = [e.kind for e in events]
    assert first == ["frame", "mapped"]
    with pytest.raises(ValueError, match="stamp"):
        slam.track(images[0].stamp, images[0].color, images[0].depth)
    assert [e.kind for e in events] == ["refused"]
    run(slam, images[1:])
    later = list(events)
    frames = [e for e in later if e.kind == "frame"]
    assert [e.values["index"] for e in frames] == list(range(1, 12)) and events.poll() is None
    assert frames[-1].frame is not None and frames[-1].frame.is_tracked
    with pytest.raises(RuntimeError, match="images"):
        _ = frames[-1].frame.mask
    assert len(list(few)) == 2 and few.missed > 0 and events.missed == 0


def test_a_finished_run_takes_no_frames(room: sp.Simulation, images: list[sp.RgbdFrame]) -> None:
    with sp.Slam(room.camera) as slam:
        run(slam, images[:3])
    slam.finish()
    assert slam.is_finished and len(slam.trajectory()) == 3
    with pytest.raises(RuntimeError, match="finish"):
        slam.track(9.0, images[0].color, images[0].depth)


def test_live_runs_return_every_frame(room: sp.Simulation, images: list[sp.RgbdFrame], tmp_path: Path) -> None:
    asked = []

    def detector(image: np.ndarray) -> list[sp.Detection]:
        asked.append(threading.get_ident())
        return [sp.Detection("person", 0.5, (10, 10, 50, 50))]

    slam = sp.Slam(room.camera, None, detector, live=True)
    kinds: list[str] = []
    listener = threading.Thread(target=lambda: kinds.extend(e.kind for e in slam.events()))
    listener.start()
    frames = []
    for i in images:
        frames.append(slam.track(i.stamp, i.color, i.depth, depth_stamp=i.depth_stamp))
    assert [f.index for f in frames] == list(range(12)) and frames[-1].is_tracked
    assert frames[-1].mask.shape == (480, 640)
    slam.save(tmp_path / "early.spmap")
    slam.finish()
    listener.join(timeout=10)
    assert not listener.is_alive() and "mapped" in kinds
    assert asked and threading.get_ident() not in asked
    assert len(slam.trajectory()) == 12
    slam.save(tmp_path / "late.spmap")
    with pytest.raises(RuntimeError):
        slam.track(9.0, images[0].color, images[0].depth)


def test_live_runs_take_detections_and_refuse_late_frames(room: sp.Simulation, images: list[sp.RgbdFrame]) -> None:
    slam = sp.Slam(room.camera, live=True)
    for i in images[:4]:
        frame = slam.track(i.stamp, i.color, i.depth, [(100, 100, 200, 300, 0.9, 0)])
    assert any(o.class_name == "person" for o in frame.objects)
    with pytest.raises(ValueError, match="stamp"):
        slam.track(images[0].stamp, images[0].color, images[0].depth)
    assert slam.track(images[4].stamp, images[4].color, images[4].depth).is_tracked
    # Dropping an unfinished run ends it.
    del slam


def test_dense_surface_is_fused_only_on_request(room: sp.Simulation, images: list[sp.RgbdFrame], tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="dense"):
        _ = sp.Slam(room.camera).dense
    for live in (False, True):
        slam = sp.Slam(room.camera, live=live, dense=0.04)
        run(slam, images)
        dense = slam.dense
        assert dense.voxel == 0.04
        mesh = dense.mesh()
        assert mesh.vertices.shape == mesh.normals.shape == mesh.colors.shape and mesh.triangles.shape[1] == 3
        assert mesh.area > 0.5 and mesh.triangles.max() < len(mesh.vertices)
        # At its borders the mesh extends to where the distance is not 0.
        near = np.abs(dense.distance(mesh.vertices))
        assert np.nanmedian(near) < 0.001 and np.nanmax(near) < 0.16
        assert np.isnan(dense.distance([[50.0, 50.0, 50.0]]))[0]
    mesh.save(tmp_path / "room.ply")
    assert (tmp_path / "room.ply").read_bytes().startswith(b"ply")
    with pytest.raises(ValueError, match="path"):
        mesh.save(tmp_path / "room.obj")
    slam.save(tmp_path / "room.spmap")
    again = sp.Slam.load(tmp_path / "room.spmap", room.camera, dense=True)
    assert again.dense.voxel == 0.04 and len(again.dense.mesh().triangles) > 0
    grid = dense.grid(up=(0, -1, 0))
    if grid is not None:
        assert set(np.unique(grid.cells)) <= {-1, 0, 100}
        grid.save(tmp_path / "plan.yaml")
        assert (tmp_path / "plan.pgm").exists()


def test_threads_can_track_concurrently(room: sp.Simulation, images: list[sp.RgbdFrame]) -> None:
    slam = sp.Slam(room.camera)
    refused = []

    def track(part: list[sp.RgbdFrame]) -> None:
        for i in part:
            try:
                slam.track(i.stamp, i.color, i.depth)
            except ValueError:
                refused.append(i.stamp)

    threads = [threading.Thread(target=track, args=(images[k::3],)) for k in range(3)]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    assert len(slam.trajectory()) + len(refused) == 12


ENDS = """
import sys, threading, time
import stillpoint_slam as sp

room = sp.simulate("xyz", frames=40, camera=sp.Camera(160, 120, 134.0, 134.0, 79.5, 59.5))

def slow(image):
    time.sleep(0.05)
    return []

def track():
    for i in room:
        slam.track(i.stamp, i.color, i.depth)

slam = sp.Slam(room.camera, None, None if "none" in sys.argv else slow, live="live" in sys.argv)
if "thread" in sys.argv:
    threading.Thread(target=track, daemon=True).start()
    time.sleep(0.15)
else:
    for i, _ in zip(room, range(6)):
        slam.track(i.stamp, i.color, i.depth)
print("end", flush=True)
"""


@pytest.mark.parametrize("how", ["live", "live thread", "thread", "none thread", "live none thread"])
def test_interpreter_exits_while_threads_are_working(how: str) -> None:
    children = [subprocess.Popen([sys.executable, "-c", ENDS, *how.split()], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(3)]
    for child in children:
        out, said = child.communicate(timeout=60)
        assert (child.returncode, out, said) == (0, "end\n", "")


def test_imu_is_used_and_reported() -> None:
    room = sp.simulate("rpy_60", frames=30, imu=True)
    assert room.has_imu and not sp.simulate("rpy", frames=3).has_imu
    with sp.Slam(room.camera, imu=True) as slam:
        for image in room:
            assert image.imu.shape[1] == 7 and len(image.imu) > 0
            frame = slam.track(image.stamp, image.color, image.depth, depth_stamp=image.depth_stamp, imu=image.imu)
    known = frame.inertial
    assert known is not None and known["state"] in ("confirmed", "unconfirmed") and known["reason"] is None
    assert known["gyro_bias"].shape == (3,) and known["rotation"].shape == (4,)
    assert abs(known["time_offset"]) < 0.02
    # A mount as a matrix equals the camera's own.
    texts = [slam.trajectory().to_tum()]
    assert sp.run(room, progress=False).trajectory.to_tum() == texts[0]
    with sp.Slam(room.camera, imu=np.eye(4)) as slam:
        for image in room:
            slam.track(image.stamp, image.color, image.depth, depth_stamp=image.depth_stamp, imu=image.imu.tolist())
    assert slam.trajectory().to_tum() == texts[0]
    assert sp.run(room, imu=False, progress=False).slam.camera is not None


def test_rotated_imu_is_ignored() -> None:
    room = sp.simulate("rpy_60", frames=90, imu=True)
    turned = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    with sp.Slam(room.camera, imu=turned) as slam:
        for image in room:
            frame = slam.track(image.stamp, image.color, image.depth, depth_stamp=image.depth_stamp, imu=image.imu)
    assert frame.inertial is not None and frame.inertial["state"] == "ignored" and "camera_from_imu" in frame.inertial["reason"]


def test_invalid_imu_samples_are_refused_with_a_reason() -> None:
    room = sp.simulate("xyz", frames=2, imu=True)
    image = room[0]
    with pytest.raises(ValueError, match=r"imu: expected a camera of a file with a table \[imu\]"):
        sp.Slam(sp.Camera.preset("tum_fr1"), imu=True)
    with pytest.raises(ValueError, match="imu: expected True, or how the sensor stands"):
        sp.Slam(room.camera, imu=np.zeros((4, 4)))
    with pytest.raises(TypeError, match="imu: expected True, or how the sensor stands"):
        sp.Slam(room.camera, imu="bmi055")
    plain = sp.Slam(room.camera)
    good = np.array([[0.0, 0, 0, 0, 0, -9.8, 0], [0.01, 0, 0, 0, 0, -9.8, 0]])
    with pytest.raises(ValueError, match=r"begin with Slam\(\.\.\., imu=camera_from_imu\)"):
        plain.track(image.stamp, image.color, image.depth, imu=good)
    slam = sp.Slam(room.camera, imu=True)
    for bad, words in [
        (good[:, :6], "shape"),
        (good[::-1], "row 1"),
        (good * np.nan, "row 0"),
        (good[0], "shape"),
    ]:
        with pytest.raises(ValueError, match=f"imu: expected an array of N x 7.*{words}"):
            slam.track(image.stamp, image.color, image.depth, imu=bad)
    assert slam.track(image.stamp, image.color, image.depth, imu=good[:0]).is_tracked
