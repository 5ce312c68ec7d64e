"""Runs RTAB-Map's RGB-D odometry (node RTABMapVIO of PyPI depthai) on a folder: rtabmap.py FOLDER OUT.txt [--frames N]. Also writes OUT.json. Needs g++.

The node reads the calibration of a connected camera. A small preloaded library, built here, provides it instead.
"""
import argparse
import datetime
import importlib.util
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

STAND_IN = r"""
#include <cstdlib>
#include <dlfcn.h>
#include <filesystem>
#include <optional>

using Make = void (*)(void *, std::filesystem::path, std::optional<bool>);

extern "C" void *stand_in(void *calibration, void *) asm("_ZN3dai10DeviceBase14getCalibrationEv");
void *stand_in(void *calibration, void *) {
    void *core = dlopen(std::getenv("PEER_CORE"), RTLD_NOW | RTLD_NOLOAD);
    Make make = reinterpret_cast<Make>(dlsym(core, "_ZN3dai18CalibrationHandlerC1ENSt10filesystem7__cxx114pathESt8optionalIbE"));
    if (make == nullptr) std::_Exit(3);
    make(calibration, std::filesystem::path(std::getenv("PEER_CALIBRATION")), std::nullopt);
    return calibration;
}
"""
# Timeouts for a frame's pose, s. The first frame never gets one.
WAIT, WAIT_AT_FIRST = 6.0, 1.5


def load_stand_in():
    """Restarts the script with the stand-in library preloaded."""
    package = Path(importlib.util.find_spec("depthai").origin).parent
    cores = [*package.glob("depthai.libs/libdepthaicore-*.so"), *package.parent.glob("depthai.libs/libdepthaicore-*.so")]
    if not cores:
        sys.exit("depthai 3.12 was expected, which has libdepthaicore beside it; install depthai==3.12.0")
    scratch = Path(tempfile.mkdtemp(prefix="rtabmap-"))
    (scratch / "stand_in.cpp").write_text(STAND_IN)
    library = scratch / "stand_in.so"
    subprocess.run(["g++", "-std=c++17", "-shared", "-fPIC", "-o", library, scratch / "stand_in.cpp", "-ldl"], check=True)
    environment = os.environ | {
        "LD_PRELOAD": str(library),
        "PEER_CORE": str(cores[0].resolve()),
        "PEER_CALIBRATION": str(scratch / "calibration.json"),
    }
    os.execve(sys.executable, [sys.executable, "-B", *sys.argv], environment)


def of_camera(q):
    """The orientation of a camera (x right, y down, z forward) from that of its base (x forward, y left, z up), q: x, y, z, w."""
    x, y, z, w = q.qx, q.qy, q.qz, q.qw
    return [0.5 * v for v in (-w + x - y - z, w + x + y - z, -w + x + y + z, w + x - y + z)]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder")
    parser.add_argument("out")
    parser.add_argument("--frames", type=int)
    a = parser.parse_args()
    if "PEER_CALIBRATION" not in os.environ:
        load_stand_in()

    import cv2
    import depthai as dai
    import numpy as np
    from folder import Clock, Folder

    folder, clock = Folder(a.folder, a.frames), Clock()
    camera = folder.camera
    width, height = camera["width"], camera["height"]
    k = np.array([[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1]], float)
    straight = cv2.initUndistortRectifyMap(k, np.array(folder.lens), None, k, (width, height), cv2.CV_32FC1)

    handler = dai.CalibrationHandler()
    colour, left, right = (getattr(dai.CameraBoardSocket, f"CAM_{c}") for c in "ABC")
    for socket in (colour, left, right):
        handler.setCameraIntrinsics(socket, k.tolist(), width, height)
        handler.setDistortionCoefficients(socket, [0.0] * 14)
        handler.setCameraType(socket, dai.CameraModel.Perspective)
    one = np.eye(3).tolist()
    handler.setCameraExtrinsics(left, right, one, [-7.5, 0, 0], [-7.5, 0, 0])
    handler.setCameraExtrinsics(right, colour, one, [3.75, 0, 0], [3.75, 0, 0])
    handler.setImuExtrinsics(colour, one, [0, 0, 0], [0, 0, 0])
    handler.setStereoLeft(left, one)
    handler.setStereoRight(right, one)
    handler.eepromToJsonFile(os.environ["PEER_CALIBRATION"])

    pipeline = dai.Pipeline(createImplicitDevice=False)
    odometry = pipeline.create(dai.node.RTABMapVIO)
    colours, depths = odometry.rect.createInputQueue(), odometry.depth.createInputQueue()
    _inertial = odometry.imu.createInputQueue()
    poses = odometry.transform.createOutputQueue(maxSize=2000, blocking=False)
    for node in pipeline.getAllNodes():
        if node.getName() == "Sync":
            node.setRunOnHost(True)
    pipeline.start()

    def message(image, kind, stamp, number):
        m = dai.ImgFrame()
        m.setType(kind)
        m.setWidth(width)
        m.setHeight(height)
        m.setData(np.ascontiguousarray(image).view(np.uint8).reshape(-1))
        m.setTimestamp(datetime.timedelta(seconds=stamp))
        m.setTimestampDevice(datetime.timedelta(seconds=stamp))
        m.setSequenceNum(number)
        m.setInstanceNum(0)
        m.setTransformation(dai.ImgTransformation(width, height, k.tolist()))
        return m

    def wait(seconds):
        until = time.perf_counter() + seconds
        while time.perf_counter() < until:
            pose = poses.tryGet()
            if pose is not None:
                return pose
            time.sleep(0.001)
        return None

    lines = []
    for number, (stamp, colour, depth) in enumerate(folder.images()):
        grey = cv2.remap(cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY), *straight, cv2.INTER_LINEAR)
        millimetres = np.round(depth * (1000.0 / camera["depth_scale"])).astype(np.uint16)
        millimetres = cv2.remap(millimetres, *straight, cv2.INTER_NEAREST)
        with clock:
            colours.send(message(grey, dai.ImgFrame.Type.GRAY8, stamp, number))
            depths.send(message(millimetres, dai.ImgFrame.Type.RAW16, stamp, number))
            pose = wait(WAIT if number > 3 else WAIT_AT_FIRST)
        if pose is not None:
            p, (x, y, z, w) = pose.getTranslation(), of_camera(pose.getQuaternion())
            lines.append(f"{stamp:.6f} {p.x:.6f} {p.y:.6f} {p.z:.6f} {x:.7f} {y:.7f} {z:.7f} {w:.7f}\n")
        elif number > 8 and not lines:
            sys.exit("RTAB-Map gave no pose for the first nine frames")
    Path(a.out).write_text("".join(lines))
    clock.write(a.out, len(folder.pairs))
    os._exit(0)  # depthai's threads never end


main()
