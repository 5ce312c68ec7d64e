"""Opens, runs, records and simulates recordings."""

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
        camera: a preset or a camera file; None for the recording's own, or a guess.
        color: whether to decode colours, or only grey images.
        start: number of frames to skip at the start.
        max_frames: maximum number of frames; None for all.

    Raises:
        FileNotFoundError: the path does not exist.
        ValueError: unknown format.
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
    """Simulates a room with exact ground truth: an iterable of its frames. See :class:`Simulation`.

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
    """Starts a recording: a folder in TUM's layout, or an MCAP file if the path ends with ``.mcap``. See :class:`Recorder`.

    Args:
        path: must not exist.
        camera: as for :class:`Slam`.
        color_order: ``rgb`` or ``bgr``.
        jpeg: whether a folder stores colour images as JPEG instead of PNG.
    """
    return Recorder(path, camera, color_order=color_order, jpeg=jpeg)


class _Source:
    """Input and arguments of a run, for its result."""

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
    """Results of a run over a recording.

    Attributes:
        slam: the finished system, with map and surface.
        trajectory: final poses.
        truth: ground truth, or None.
        score: errors of the trajectory; None without ground truth that overlaps in time.
        frames: number of frames read.
        skipped: number of unreadable frames.
        lost: frames without a pose when tracked, as (index, stamp in s, reason).
        seconds: duration.
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
                # Without overlap in time there is no score.
                self.score = None

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Writes the result into a folder, creating it if necessary: the files of ``stillpoint run`` (poses, ``summary.json``, plots, the surface
        if there is one) except the log, and ``map.spmap``; also ``report.html`` if :func:`run` was called with ``out``.

        Raises:
            ValueError: the folder cannot be written.
        """
        source = self._source
        self.slam._write_result(folder, (source.name, source.layout, source.camera.name), (source.command, self.skipped, self.seconds), self.truth)
        self.slam.save(Path(folder) / "map.spmap")

    def plot(self, ax: Any = None) -> Any:
        """Plots the trajectory, with the ground truth if available, by matplotlib, and returns the axes."""
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
        path: a folder or file, or the result of :func:`open` or :func:`simulate`.
        camera, start, max_frames: as for :func:`open`.
        config, detector, live, dense: as for :class:`Slam`.
        imu: whether to use an inertial sensor with a known mount, if there is one.
        odometry: likewise for wheel odometry.
        out: folder for the result, see :meth:`Run.save`; None for none.
        report: whether to write ``report.html`` into that folder: a page that shows where the run failed.
        progress: whether to show progress, in a notebook or a terminal.
        time_limit: maximum duration, s; None for no limit.

    Raises:
        TimeoutError: the run took longer than ``time_limit``.

    >>> run(simulate("xyz", frames=5))
    <Run: 5 of 5 frames with a pose, ATE RMSE ... mm>
    """
    if out is not None and Path(out).exists() and not Path(out).is_dir():
        # Fail before the run, which may take an hour.
        raise ValueError(f"out: {os.fspath(out)}: expected a folder to write to, found a file; name another")
    pictures = report and out is not None
    # Tracking needs only grey, which takes half the decoding time.
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
