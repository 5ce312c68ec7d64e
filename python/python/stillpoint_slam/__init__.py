"""RGB-D SLAM for dynamic scenes: poses, maps and masks of moving regions, from arrays.

>>> import stillpoint_slam as sp
>>> room = sp.simulate("xyz", frames=5)
>>> with sp.Slam(room.camera) as slam:
...     for image in room:
...         frame = slam.track(image.stamp, image.color, image.depth, depth_stamp=image.depth_stamp)
>>> len(slam.trajectory())
5

Poses are ``world_from_camera`` as 4x4 matrices in metres; the camera looks along z, x is right, y is down. Depth images are registered to
their colour images. Long operations run without the interpreter's lock, and exceptions name the invalid argument.
"""

import atexit as _atexit
import sys as _sys

from . import _native
from ._native import (
    Camera,
    Config,
    Dense,
    Detection,
    Detector,
    DynamicMask,
    Event,
    Events,
    Frame,
    Grid,
    Health,
    Map,
    Mesh,
    Moving,
    Object,
    Recorder,
    Recording,
    RgbdFrame,
    RgbdFrames,
    Score,
    Simulation,
    Slam,
    Trajectory,
    Verdicts,
    __version__,
    evaluate,
)
from ._batch import Batch, batch, batch_merge
from ._run import Run, open, record, run, simulate

if _sys.executable:
    # Models from other sources are first tried in a separate process with this package's command line.
    _native.launch_by([_sys.executable, "-m", "stillpoint_slam"], _native.__file__)

# Keeps threads from returning to a finalised interpreter.
_atexit.register(_native.prepare_for_end)

__all__ = [
    "Batch",
    "Camera",
    "Config",
    "Dense",
    "Detection",
    "Detector",
    "DynamicMask",
    "Event",
    "Events",
    "Frame",
    "Grid",
    "Health",
    "Map",
    "Mesh",
    "Moving",
    "Object",
    "Recorder",
    "Recording",
    "RgbdFrame",
    "RgbdFrames",
    "Run",
    "Score",
    "Simulation",
    "Slam",
    "Trajectory",
    "Verdicts",
    "__version__",
    "batch",
    "batch_merge",
    "evaluate",
    "open",
    "record",
    "run",
    "simulate",
]
