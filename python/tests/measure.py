"""Measures the overhead of Python and memory growth: python measure.py [--minutes N]. Exit code 1 if a bound is missed."""

from __future__ import annotations

import argparse
import gc
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

import stillpoint_slam as sp

FAILED: list[str] = []


def told(name: str, value: float, bar: str, is_met: bool) -> None:
    print(f"{name}: {value:.3g} (bar {bar}){'' if is_met else ', MISSED'}", flush=True)
    if not is_met:
        FAILED.append(name)


def resident() -> float:
    """Resident memory, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


def frames(count: int) -> tuple[sp.Camera, list[tuple[np.ndarray, np.ndarray]]]:
    """Frames forwards and backwards, for an endless cycle: colour, and depth in 5000 per metre."""
    room = sp.simulate("xyz", frames=count)
    images = [(np.array(i.color), np.rint(i.depth * 5000).astype(np.uint16)) for i in room]
    return room.camera, images + images[-2:0:-1]


def unit() -> float:
    """The unit of time: median ms of OpenCV's ORB with 1000 features, one thread, over simulated images; 4.9 without OpenCV."""
    try:
        import cv2  # type: ignore[import-not-found,unused-ignore]
    except ImportError:
        print("opencv-python-headless is not there: the unit is taken to be 4.9 ms")
        return 4.9
    cv2.setNumThreads(1)
    orb, times = cv2.ORB_create(1000), []
    for image in sp.simulate("xyz", frames=30):
        gray = np.array(image.gray)
        start = time.perf_counter()
        orb.detectAndCompute(gray, None)
        times.append(1e3 * (time.perf_counter() - start))
    return float(np.median(times))


def overhead(camera: sp.Camera, images: list[tuple[np.ndarray, np.ndarray]]) -> None:
    """Measures the overhead of Python by repeated frames: they are checked, copied and decoded, but then refused."""
    slam = sp.Slam(camera)
    slam.track(1.0, *images[0])
    times = []
    for k in range(300):
        start = time.perf_counter()
        try:
            slam.track(1.0, *images[k % len(images)])
        except ValueError:
            times.append(1e3 * (time.perf_counter() - start))
    one = unit()
    found = float(np.median(times))
    told(f"ms per frame between Python and the system, where a unit is {one:.2f} ms", found, "0.1 units", found <= 0.1 * one)


def second_thread(camera: sp.Camera, images: list[tuple[np.ndarray, np.ndarray]]) -> None:
    """Speed of a counting Python thread while another one tracks, relative to counting alone: alternating rounds of half a second."""
    counted, stop = [0], threading.Event()

    def count() -> None:
        while not stop.is_set():
            for _ in range(1000):
                counted[0] += 1

    counter = threading.Thread(target=count, daemon=True)
    counter.start()
    slam, shares, number = sp.Slam(camera), [], 0
    for _ in range(8):
        speeds = []
        for busy in (False, True):
            before, start = counted[0], time.perf_counter()
            while time.perf_counter() - start < 0.5:
                if busy:
                    slam.track(number / 30, *images[number % len(images)])
                    number += 1
                else:
                    time.sleep(0.02)
            speeds.append((counted[0] - before) / (time.perf_counter() - start))
        shares.append(speeds[1] / speeds[0])
    stop.set()
    counter.join()
    share = float(np.median(shares))
    told("speed of a second thread while one tracks, by its own", share, ">= 0.8", share >= 0.8)


def dropped_objects(camera: sp.Camera, images: list[tuple[np.ndarray, np.ndarray]]) -> None:
    """Memory over a thousand systems, masks and frames, each created, used and dropped."""
    small = sp.Camera(64, 48, 55, 55, 31.5, 23.5)
    color, depth = np.ascontiguousarray(images[0][0][:48, :64]), np.ascontiguousarray(images[0][1][:48, :64])

    def once(live: bool) -> None:
        slam = sp.Slam(small, detector=lambda image: [], live=live)
        frame: Any = slam.track(0.0, color, depth)
        moving: Any = sp.DynamicMask(small).step(0.0, color, depth)
        kept = [frame.gray, frame.depth, frame.mask, frame.verdicts.pixels, moving.mask, slam.map.points, slam.trajectory().poses]
        if live:
            slam.finish()
        del kept

    levels = []
    for k in range(1250):
        once(live=k % 10 == 0)
        if k >= 250 and k % 50 == 49:
            gc.collect()
            levels.append(resident())
    rise = float(np.mean(levels[-5:]) - np.mean(levels[:5]))
    told("MB more after 1000 objects were made and dropped", rise, "<= 2", rise <= 2.0)


def ten_minutes(camera: sp.Camera, images: list[tuple[np.ndarray, np.ndarray]], minutes: float) -> None:
    """Memory over some minutes of frames at 30 Hz, faster than real time: the second half compared with the end of the first. Trajectories grow."""
    slam, levels, lost = sp.Slam(camera), [], 0
    count = int(minutes * 60 * 30)
    start = time.monotonic()
    for k in range(count):
        frame = slam.track(k / 30, *images[k % len(images)])
        lost += not frame.is_tracked
        if k % (count // 40) == 0:
            levels.append(resident())
    half = len(levels) // 2
    rise = float(np.mean(levels[-4:]) - np.mean(levels[half - 4 : half]))
    print(f"{count} frames in {time.monotonic() - start:.0f} s, {lost} lost, memory {levels[1]:.0f} to {levels[-1]:.0f} MB, {slam}")
    told(f"MB more in the second half of {minutes:g} minutes", rise, "<= 5", rise <= 5.0 and lost == 0)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0, help="minutes of frames (10)")
    parser.add_argument("--part", action="append", help="overhead, thread, objects or memory; may be repeated (all)")
    arguments = parser.parse_args()
    parts = arguments.part or ["overhead", "thread", "objects", "memory"]
    camera, images = frames(60)
    if "overhead" in parts:
        overhead(camera, images)
    if "thread" in parts:
        second_thread(camera, images)
    if "objects" in parts:
        dropped_objects(camera, images)
    if "memory" in parts:
        ten_minutes(camera, images, arguments.minutes)
    return int(bool(FAILED))


if __name__ == "__main__":
    sys.exit(main())
