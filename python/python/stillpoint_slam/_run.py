"""Whole recordings: opened, run, recorded, simulated."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ._native import Camera, Config, Detector, Recorder, Recording, Score, Simulation, Slam, Trajectory, evaluate
from ._progress import Progress


def open(
    path: str | os.PathLike[str],
    camera: str | None = None,
    *,
    color: bool = True,
    start: int = 0,
    max_frames: int | None = None,
) -> Recording:
    """Opens a data set folder (TUM, Bonn, ICL-NUIM, 7-Scenes) or a recording (MCAP, rosbag2, ROS 1 bag, RealSense): an iterable of its frames.

    Args:
        path: the folder or file.
        camera: a preset or a camera file; None guesses it, or takes the recording's own.
        color: whether the frames come with their colours; without, only grey is decoded.
        start: frames that are left out at the start.
        max_frames: frames at most.

    Raises:
        FileNotFoundError: nothing is there.
        ValueError: it is neither; the message says what was expected.
    """
    return Recording(path, camera, color=color, start=start, max_frames=max_frames)


def simulate(
    scene: str = "xyz",
    frames: int | None = None,
    *,
    seed: int = 0,
    rate: float | None = None,
    noise: bool = True,
    camera: Camera | None = None,
    imu: bool = False,
    odometry: bool = False,
) -> Simulation:
    """A simulated room with exact ground truth: an iterable of its frames. See :class:`Simulation`.

    >>> len(simulate("walking_xyz", frames=10))
    10
    """
    return Simulation(scene, frames, seed=seed, rate=rate, noise=noise, camera=camera, imu=imu, odometry=odometry)


def record(
    path: str | os.PathLike[str],
    camera: Any,
    *,
    color_order: str = "rgb",
    jpeg: bool = False,
) -> Recorder:
    """Begins a recording: a folder as TUM has it, or an MCAP file where the path ends with ``.mcap``. See :class:`Recorder`.

    Args:
        path: where nothing is yet.
        camera: as for :class:`Slam`.
        color_order: ``rgb`` or ``bgr``.
        jpeg: whether colour images of a folder are JPEG instead of PNG.
    """
    return Recorder(path, camera, color_order=color_order, jpeg=jpeg)


class _Source:
    """What a run is over, and how it was asked for."""

    def __init__(self, path: str | os.PathLike[str] | Recording | Simulation, frames: Recording | Simulation, options: Mapping[str, Any]) -> None:
        self.frames = frames
        self.truth = frames.truth
        self.camera = frames.camera
        self.layout = frames.kind if isinstance(frames, Recording) else "simulated"
        if isinstance(path, (Recording, Simulation)):
            self.name = repr(path).strip("<>")
            asked = repr(path)
        else:
            self.name = os.fspath(path)
            asked = repr(self.name)
        named = [f"{name}={getattr(value, '__name__', None) or repr(value)}" for name, value in options.items() if value]
        self.command = f"stillpoint_slam.run({', '.join([asked, *named])})"


class Run:
    """What a run over a recording gave.

    Attributes:
        slam: the finished system: map, surface.
        trajectory: final poses.
        truth: ground truth; None where there is none.
        score: the trajectory against the truth; None without truth, or where both do not overlap.
        frames: frames that were read.
        skipped: frames that could not be read.
        lost: frames without a pose at the time, as (index, stamp in s, reason).
        seconds: how long it took.
    """

    def __init__(self, slam: Slam, source: _Source, counts: tuple[int, int], lost: list[tuple[int, float, str]], seconds: float) -> None:
        self.slam = slam
        self.trajectory = slam.trajectory()
        self.truth = source.truth
        self.frames, self.skipped = counts
        self.lost = lost
        self.seconds = seconds
        self._source = source
        self.score: Score | None = None
        if self.truth is not None:
            try:
                self.score = evaluate(self.truth, self.trajectory)
            except ValueError:
                # Poses that do not overlap with the truth in time are poses all the same.
                self.score = None

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Writes the result into a folder, which is made if need be: the files that ``stillpoint run`` leaves (poses, ``summary.json``, plots, the
        surface if there is one) but for its log, and ``map.spmap``. ``report.html`` is among them where :func:`run` was given ``out``.

        Raises:
            ValueError: it cannot be written.
        """
        source = self._source
        self.slam._write_result(folder, (source.name, source.layout, source.camera.name), (source.command, self.skipped, self.seconds), self.truth)
        self.slam.save(Path(folder) / "map.spmap")

    def plot(self, ax: Any = None) -> Any:
        """Draws the trajectory, beside the truth if there is one, by matplotlib, and returns the axes."""
        return self.trajectory.plot(self.truth, ax)

    def __repr__(self) -> str:
        score = "" if self.score is None else f", ATE RMSE {1e3 * self.score.ate_rmse:.2f} mm"
        return f"<Run: {len(self.trajectory)} of {self.frames} frames with a pose{score}>"

    def _repr_html_(self) -> str:
        from ._html import run

        return run(self)


def run(
    path: str | os.PathLike[str] | Recording | Simulation,
    *,
    camera: str | None = None,
    config: Config | str | os.PathLike[str] | Mapping[str, Any] | None = None,
    detector: Detector | Callable[[Any], Any] | str | os.PathLike[str] | None = None,
    live: bool = False,
    dense: bool | float = False,
    imu: bool = True,
    odometry: bool = True,
    start: int = 0,
    max_frames: int | None = None,
    out: str | os.PathLike[str] | None = None,
    report: bool = True,
    progress: bool = True,
    time_limit: float | None = None,
) -> Run:
    """Runs a data set folder, a recording or a simulation through SLAM, as ``stillpoint run`` does.

    Args:
        path: the folder or file, or what :func:`open` or :func:`simulate` gave.
        camera, start, max_frames: as for :func:`open`.
        config, detector, live, dense: as for :class:`Slam`.
        imu: whether the inertial sensor is used, where there is one whose mount is known.
        odometry: the same of wheel odometry.
        out: folder for the result, see :meth:`Run.save`; None for none.
        report: whether ``report.html`` is in that folder: one page that shows where the run went wrong.
        progress: whether progress is shown, in a notebook or a terminal.
        time_limit: seconds that the run may take.

    Raises:
        TimeoutError: it took longer than ``time_limit``.

    >>> run(simulate("xyz", frames=5))
    <Run: 5 of 5 frames with a pose, ATE RMSE ... mm>
    """
    if out is not None and Path(out).exists() and not Path(out).is_dir():
        # A run of an hour is not to end with that.
        raise ValueError(f"out: {os.fspath(out)}: expected a folder to write to, found a file; name another")
    pictures = report and out is not None
    # Grey is all that tracking looks at, and half of the work of decoding.
    color = detector is not None or bool(dense) or pictures
    recording = path if isinstance(path, (Recording, Simulation)) else open(path, camera, color=color, start=start, max_frames=max_frames)
    options = {"camera": camera, "config": config, "detector": detector, "live": live, "dense": dense, "start": start, "max_frames": max_frames}
    source = _Source(path, recording, options)
    imu = imu and recording.has_imu
    odometry = odometry and recording.has_odometry
    slam = Slam(recording.camera, config, detector, live, dense=dense, imu=imu, odometry=odometry)
    slam._keep_result(pictures)
    lost: list[tuple[int, float, str]] = []
    frames, begin = 0, time.monotonic()
    with Progress(len(recording), progress) as bar, slam:
        images = iter(recording)
        for image in images:
            pixels = image.color if color else image.gray
            beside = {"imu": image.imu if imu else None, "odometry": image.odometry if odometry else None}
            frame = slam.track(image.stamp, pixels, image.depth, depth_stamp=image.depth_stamp, **beside)
            frames += 1
            if not frame.is_tracked:
                lost.append((frame.index, frame.stamp, frame.reason or ""))
            bar.step(f", {len(lost)} lost" if lost else "")
            if time_limit is not None and time.monotonic() - begin > time_limit:
                raise TimeoutError(f"took longer than {time_limit:g} s")
    result = Run(slam, source, (frames, images.skipped), lost, time.monotonic() - begin)
    if out is not None:
        result.save(out)
    return result
