"""Recordings, simulations, scores, the command line, notebooks."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import stillpoint_slam as sp


def record(path: Path, room: sp.Simulation, images: list[sp.RgbdFrame]) -> None:
    with sp.record(path, room.camera) as recorder:
        for i in images:
            recorder.add(i.stamp, i.color, i.depth, depth_stamp=i.depth_stamp, truth=i.truth)
    with pytest.raises(RuntimeError, match="closed"):
        recorder.add(9.0, images[0].color, images[0].depth)
    with pytest.raises(OSError, match="path"):
        sp.record(path, room.camera)


@pytest.mark.parametrize("name", ["folder", "file.mcap"])
def test_recordings_round_trip(name: str, room: sp.Simulation, images: list[sp.RgbdFrame], tmp_path: Path) -> None:
    path = tmp_path / name
    record(path, room, images)
    recording = sp.open(path)
    again = list(recording)
    assert len(recording) == len(again) == len(images)
    for a, b in zip(images, again):
        assert abs(a.stamp - b.stamp) < 1e-5 and abs(a.depth_stamp - b.depth_stamp) < 1e-5
        assert np.array_equal(a.color, b.color) and np.allclose(a.depth, b.depth, atol=2e-4)
    assert recording.camera.fx == room.camera.fx
    if name == "folder":
        assert recording.truth is not None and np.allclose(recording.truth.poses, room.truth.poses, atol=1e-6)
    assert len(list(sp.open(path, start=3, max_frames=4))) == 4
    grey = next(iter(sp.open(path, color=False)))
    assert grey.gray.shape == (480, 640)
    with pytest.raises(ValueError, match="color"):
        _ = grey.color
    with pytest.raises(ValueError, match="start"):
        sp.open(path, start=1000)


def test_runs_are_scored_and_saved(room: sp.Simulation, images: list[sp.RgbdFrame], tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with sp.record(tmp_path / "room", room.camera) as recorder:
        for i in images:
            recorder.add(i.stamp, i.color, i.depth, depth_stamp=i.depth_stamp, truth=i.truth)
    result = sp.run(tmp_path / "room", out=tmp_path / "out")
    assert result.frames == 12 and not result.lost and result.score is not None and result.score.ate_rmse < 0.005
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["tracked"] == 12 and summary["input"]["name"] == str(tmp_path / "room") and (tmp_path / "out" / "map.spmap").exists()
    assert len(sp.Trajectory.from_file(tmp_path / "out" / "trajectory.txt")) == 12
    for value in (result, result.trajectory, result.score, result.slam, result.slam.map, result.slam.map.keyframes):
        assert value._repr_html_().startswith("<table")
    assert "None" not in result._repr_html_()
    # Without a terminal there is no output.
    assert capfd.readouterr() == ("", "")
    with pytest.raises(FileNotFoundError):
        sp.run(tmp_path / "nothing")


def test_run_writes_the_files_of_the_command_line(room: sp.Simulation, images: list[sp.RgbdFrame], tmp_path: Path) -> None:
    with sp.record(tmp_path / "room", room.camera) as recorder:
        for i in images:
            recorder.add(i.stamp, i.color, i.depth, depth_stamp=i.depth_stamp, truth=i.truth)
    command = [sys.executable, "-m", "stillpoint_slam", "run", str(tmp_path / "room"), "--out", str(tmp_path / "line"), "--dense", "-q"]
    assert subprocess.run(command, cwd=tmp_path).returncode == 0
    sp.run(tmp_path / "room", out=tmp_path / "out", dense=True)
    line, out = ({p.name for p in (tmp_path / folder).iterdir()} for folder in ("line", "out"))
    assert out == line - {"run.log"} | {"map.spmap"}
    for name in ("trajectory.txt", "trajectory_online.txt", "keyframes.txt", "frames.csv", "mesh.ply"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "line" / name).read_bytes(), name

    def data(folder: str) -> dict[str, object]:
        text = (tmp_path / folder / "report.html").read_text(encoding="utf-8")
        return json.loads(re.search(r'<script id="data" type="application/json">(.*?)</script>', text, re.S)[1])[0]

    ours, theirs = data("out"), data("line")
    for part in ("image", "map", "surface", "keyframes", "marks", "objects", "pictures"):
        assert ours[part] == theirs[part], part
    # All figures of frames except times.
    assert {k: v for k, v in ours["frames"].items() if k != "time_ms"} == {k: v for k, v in theirs["frames"].items() if k != "time_ms"}
    assert len(ours["pictures"]["webp"]) == 12 and ours["frames"]["time_ms"]
    assert ours["command"] == f"stillpoint_slam.run({str(tmp_path / 'room')!r}, dense=True)"
    assert ours["summary"]["frames"] == 12 and ours["summary"]["accuracy"] == theirs["summary"]["accuracy"]
    # Likewise for a live run, which may skip pictures when busy.
    sp.run(tmp_path / "room", out=tmp_path / "out", live=True)
    assert len(data("out")["pictures"]["webp"]) > 0 and not (tmp_path / "out" / "mesh.ply").exists()
    sp.run(room, out=tmp_path / "none", report=False)
    assert not (tmp_path / "none" / "report.html").exists() and (tmp_path / "none" / "summary.json").exists()
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match="^out: .*expected a folder"):
        sp.run(room, out=tmp_path / "file")


def test_damaged_frames_are_skipped_with_a_warning(room: sp.Simulation, images: list[sp.RgbdFrame], tmp_path: Path) -> None:
    with sp.record(tmp_path / "room", room.camera) as recorder:
        for i in images[:4]:
            recorder.add(i.stamp, i.color, i.depth, depth_stamp=i.depth_stamp)
    next(iter(sorted((tmp_path / "room" / "rgb").iterdir())[1:])).write_bytes(b"no image")
    with pytest.warns(RuntimeWarning, match="skipped"):
        assert len(list(sp.open(tmp_path / "room"))) == 3
    with pytest.warns(RuntimeWarning, match="skipped"):
        assert sp.run(tmp_path / "room", progress=False).skipped == 1


def test_scores_match_known_trajectory_errors(room: sp.Simulation) -> None:
    truth = room.truth
    moved = truth.poses.copy()
    moved[:, :3, 3] += [0.5, 0, 0]
    assert sp.evaluate(truth, (truth.stamps, moved)).ate_rmse < 1e-9
    moved[::2, 0, 3] += 0.02
    score = sp.evaluate(truth, (truth.stamps, moved))
    assert 0.009 < score.ate_rmse < 0.011 and score.pairs == len(truth) and score.ate["count"] == len(score.errors) == len(truth)
    assert np.allclose(np.linalg.norm(score.aligned - score.reference, axis=1), score.errors)
    with pytest.raises(ValueError, match="truth, estimate"):
        sp.evaluate(truth, sp.Trajectory(truth.stamps + 100, truth.poses))


def test_simulations_provide_ground_truth() -> None:
    room = sp.simulate("walking_xyz", frames=3)
    assert len(room) == 3 and room[-1].index == 2
    with pytest.raises(IndexError, match="index"):
        _ = room[3]
    first = next(iter(room))
    assert np.array_equal(first.color, room[0].color) and np.allclose(first.truth, room.truth.poses[0])
    assert room.mask(2).shape == (480, 640)
    with pytest.raises(ValueError, match="scene"):
        sp.simulate("wolking_xyz")
    with pytest.raises(ValueError, match="frames"):
        sp.simulate("xyz", 10**12)


def test_mask_covers_walking_people() -> None:
    room = sp.simulate("walking_xyz", frames=45)
    filter = sp.DynamicMask(room.camera)
    found = missed = 0
    for i, image in enumerate(room):
        moving = filter.step(image.stamp, image.color, image.depth, room.detections(i), depth_stamp=image.depth_stamp, pose=image.truth)
        if i > 30:
            truth = room.mask(i) > 0
            found += int((truth & (moving.mask > 0)).sum())
            missed += int((truth & (moving.mask == 0)).sum())
    assert found > missed
    ys, xs = np.nonzero(room.mask(44))
    verdicts = filter.verdicts(np.stack([xs, ys], 1)[::50])
    assert verdicts.dynamic.mean() > 0.5 and np.allclose(moving.pose, room[44].truth)
    assert any(o.class_name == "person" for o in moving.objects)


def command(*arguments: object, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "stillpoint_slam", *map(str, arguments)], capture_output=True, text=True, **options)


def test_command_line_is_available(tmp_path: Path) -> None:
    assert command("--version").stdout.strip() == f"stillpoint {sp.__version__}"
    done = command("run", tmp_path / "none")
    assert done.returncode == 2 and "expected" in done.stderr
    assert command("frobnicate").returncode == 2
    done = command("simulate", "--scene", "xyz", "--frames", "5", "--out", tmp_path / "room", "-q")
    assert done.returncode == 0 and (tmp_path / "room" / "rgb.txt").exists()


@pytest.mark.skipif(os.name != "posix", reason="signals are POSIX's")
def test_ctrl_c_ends_the_command_line_cleanly(tmp_path: Path) -> None:
    command("simulate", "--scene", "xyz", "--frames", "120", "--out", tmp_path / "room", "-q")
    arguments = [sys.executable, "-m", "stillpoint_slam", "run", str(tmp_path / "room"), "--live", "--detector", "none", "--no-report", "--out", str(tmp_path / "out")]
    child = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    time.sleep(2.0)
    child.send_signal(signal.SIGINT)
    _, said = child.communicate(timeout=60)
    assert child.returncode == 1 and "interrupted" in said and "Traceback" not in said, said
    assert (tmp_path / "out" / "trajectory.txt").exists()


def test_ctrl_c_ends_a_wait_for_events(room: sp.Simulation) -> None:
    program = (
        "import signal\n"
        "import stillpoint_slam as sp\n"
        # The signal may be ignored if the tests run in the background.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "slam = sp.Slam(sp.Camera(64, 48, 55, 55, 31.5, 23.5), live=True)\n"
        "print('waits', flush=True)\n"
        "next(slam.events())\n"
    )
    child = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert child.stdout is not None and child.stdout.readline() == "waits\n"
    time.sleep(0.5)
    child.send_signal(signal.SIGINT)
    _, said = child.communicate(timeout=20)
    assert "KeyboardInterrupt" in said and child.returncode != 0


def test_cameras_are_converted_from_other_libraries() -> None:
    k = [525.0, 0, 319.5, 0, 525.0, 239.5, 0, 0, 1]
    info = {"width": 640, "height": 480, "K": k, "D": [0.1, -0.2, 0.001, 0.002, 0.05], "distortion_model": "plumb_bob"}
    camera = sp.Camera.from_info(info, depth_scale=1000)
    assert np.allclose(camera.distortion, info["D"]) and np.allclose(camera.k.ravel(), k)

    class Intrinsics:
        width, height, fx, fy, ppx, ppy = 640, 480, 525.0, 525.0, 319.5, 239.5
        coeffs, model = [0.0] * 5, "distortion.inverse_brown_conrady"

    assert sp.Camera.from_info(Intrinsics()).cx == 319.5 and sp.Slam(Intrinsics()).camera.width == 640
    for change in ({"D": [0.1] * 8, "distortion_model": "rational_polynomial"}, {"D": [0.1, 0.1, 0, 0], "distortion_model": "equidistant"}):
        with pytest.raises(ValueError, match="camera"):
            sp.Camera.from_info({**info, **change})
    # REP 104: binning and region of interest; K missing; impossible values.
    roi = {"x_offset": 80, "y_offset": 40, "width": 480, "height": 360}
    part = sp.Camera.from_info({**info, "binning_x": 2, "binning_y": 2, "roi": roi})
    assert (part.width, part.height) == (240, 180) and np.allclose(part.k[0], [262.5, 0, 119.75])
    projection = [520.0, 0, 318.0, 0, 0, 521.0, 241.0, 0, 0, 0, 1, 0]
    assert sp.Camera.from_info({**info, "K": [0.0] * 9, "P": projection}).fy == 521.0
    for change, said in (({"roi": {**roi, "width": 640}}, "640 x 360 px at"), ({"K": [525.0, 0, 0, 0, 525.0, 0, 0, 0, 1]}, "cx = 0.0")):
        with pytest.raises(ValueError, match=said):
            sp.Camera.from_info({**info, **change})
    assert "tum_fr1" in sp.Camera.presets() and sp.Camera.preset("fr1") == sp.Camera.preset("tum_fr1")


def test_plots_are_drawn_with_matplotlib(room: sp.Simulation, images: list[sp.RgbdFrame]) -> None:
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    result = sp.run(room, progress=False)
    frame = sp.Slam(room.camera).track(0.0, images[0].color, images[0].depth)
    for axes in (result.plot(), result.trajectory.plot(), result.slam.map.plot(), frame.plot()):
        assert axes.figure is not None
    assert frame._repr_html_().startswith("<table")
