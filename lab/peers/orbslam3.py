"""Runs ORB-SLAM3 (PyPI pyorbslam3) on a folder: orbslam3.py FOLDER OUT.txt [--vocabulary FILE] [--frames N]. Also writes OUT.json."""
import argparse
import tempfile
from pathlib import Path

import cv2
import numpy as np
import pyorbslam3
from folder import Clock, Folder

# Settings of ORB-SLAM3's examples for TUM RGB-D; those of the viewer are required although none is opened.
SETTINGS = {
    "Stereo.ThDepth": 40.0,
    "Stereo.b": 0.07732,
    "ORBextractor.nFeatures": 1000,
    "ORBextractor.scaleFactor": 1.2,
    "ORBextractor.nLevels": 8,
    "ORBextractor.iniThFAST": 20,
    "ORBextractor.minThFAST": 7,
    "Viewer.KeyFrameSize": 0.05,
    "Viewer.KeyFrameLineWidth": 1.0,
    "Viewer.GraphLineWidth": 0.9,
    "Viewer.PointSize": 2.0,
    "Viewer.CameraSize": 0.08,
    "Viewer.CameraLineWidth": 3.0,
    "Viewer.ViewpointX": 0.0,
    "Viewer.ViewpointY": -0.7,
    "Viewer.ViewpointZ": -1.8,
    "Viewer.ViewpointF": 500.0,
}


def settings(folder):
    camera = folder.camera
    values = {f"Camera1.{k}": float(camera[k]) for k in ("fx", "fy", "cx", "cy")}
    values |= dict(zip(("Camera1.k1", "Camera1.k2", "Camera1.p1", "Camera1.p2", "Camera1.k3"), map(float, folder.lens)))
    values |= {"Camera.width": camera["width"], "Camera.height": camera["height"], "Camera.fps": 30, "Camera.RGB": 1}
    values |= {"RGBD.DepthMapFactor": float(camera["depth_scale"])} | SETTINGS
    lines = ["%YAML:1.0", 'File.version: "1.0"', 'Camera.type: "PinHole"', *(f"{k}: {v}" for k, v in values.items())]
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder")
    parser.add_argument("out")
    parser.add_argument("--vocabulary", help="default: ORBvoc.txt, which the package downloads once (139 MB)")
    parser.add_argument("--frames", type=int)
    a = parser.parse_args()
    folder, clock = Folder(a.folder, a.frames), Clock()
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "settings.yaml"
        file.write_text(settings(folder))
        slam = pyorbslam3.Slam(a.vocabulary or pyorbslam3.vocabulary_path(), str(file), pyorbslam3.Sensor.RGBD, False)
    for stamp, colour, depth in folder.images():
        rgb, depth = cv2.cvtColor(colour, cv2.COLOR_BGR2RGB), depth.astype(np.float32)
        with clock:
            slam.track_rgbd(rgb, depth, stamp)
    slam.shutdown()
    slam.save_trajectory_tum(a.out)
    # A frame after a loss may be written twice: keep its last pose.
    lines = {line.split()[0]: line for line in Path(a.out).read_text().splitlines(keepends=True)}
    Path(a.out).write_text("".join(sorted(lines.values(), key=lambda line: float(line.split()[0]))))
    clock.write(a.out, len(folder.pairs))


main()
