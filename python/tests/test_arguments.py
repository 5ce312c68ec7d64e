"""Invalid arguments raise an exception that names the argument, and change nothing."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hn

import stillpoint_slam as sp

CAMERA = sp.Camera(64, 48, 55.0, 55.0, 31.5, 23.5)
COLOR = np.random.default_rng(1).integers(0, 256, (48, 64, 3), dtype=np.uint8)
DEPTH = np.full((48, 64), 2000, dtype=np.uint16)
CASES = int(os.environ.get("STILLPOINT_CASES", "2000"))


def structured() -> np.ndarray:
    """A view of a field of records: neither contiguous nor aligned."""
    records = np.zeros((48, 64), dtype=[("flag", "u1"), ("z", "u2")])
    records["z"] = DEPTH
    return records["z"]


class Broken:
    """An object whose attributes raise exceptions."""

    width = height = property(lambda self: 1 / 0)

    def __index__(self) -> int:
        raise OSError("no")

    def __len__(self) -> int:
        return -1

    def __array__(self, *_: object, **__: object) -> np.ndarray:
        raise MemoryError("no")


JUNK: list[Any] = [
    None, True, False, "", "word", b"bytes", "\ud800", object(), Broken(), {}, {1: 2}, set(), [], (), [[]], [None], 0, -1, 10**30, -(10**30),
    math.nan, math.inf, -math.inf, 1e300, -1e300, 1j, Decimal("NaN"), Fraction(1, 3), np.float32("nan"), np.float64("inf"), np.bool_(True),
    np.datetime64("NaT", "s"), np.array(None), np.array([]), np.zeros(()), np.zeros((0, 0)), np.zeros((48, 64, 3)), np.zeros((48, 64), dtype=bool),
    np.zeros((48, 64), dtype=object), np.zeros((48, 64), dtype=complex), np.zeros((48, 64), dtype="S3"), np.zeros((48, 64), dtype=">u2"),
    np.zeros((64, 48), dtype=np.uint16), np.zeros((48, 64, 1), dtype=np.uint16), np.zeros((48, 64, 4), dtype=np.uint8),
    np.broadcast_to(np.uint8(1), (1 << 30, 1 << 30, 3)), np.broadcast_to(np.uint16(1), (1 << 30, 1 << 30)),
    np.broadcast_to(np.float64(1), (1 << 40, 6)), np.zeros((3, 6)), np.full((2, 6), np.nan), np.zeros((2, 5)), np.eye(4)[:3],
    np.zeros((4, 4)), np.full((4, 4), np.nan), [[0, 0, 1, 1, 2.0, 0]], [[0, 0, 1, 1, 0.5, 80]], [[5, 5, 1, 1, 0.5, 0]], ["word"], [object()],
    [[1, 2]], [1, 2, 3, 4, 5, 6], [[0, 0, 1, 1, 0.5, 0.5]], range(5), iter([]), (i for i in ()), memoryview(b"abc"), type, len, np, lambda: None,
    Path("/no/such/file"), np.rec.array([(1, 2.0)], dtype=[("a", int), ("b", float)]),
]  # fmt: skip

# Any kind of value, and arrays of any type and shape.
ANYTHING = st.one_of(
    st.sampled_from(JUNK),
    st.integers(),
    st.floats(),
    st.text(max_size=5),
    st.lists(st.one_of(st.floats(), st.none(), st.text(max_size=2)), max_size=7),
    hn.arrays(
        dtype=st.one_of(hn.scalar_dtypes(), hn.unicode_string_dtypes(max_len=2)),
        shape=hn.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=7),
    ),
)


def usable(name: str, value: Any) -> bool:
    """Whether a generated value is valid."""
    if value is None:
        return name in ("depth_stamp", "detections")
    if name in ("stamp", "depth_stamp"):
        if isinstance(value, (float, np.floating)):
            return math.isfinite(value) and abs(value) <= 1e11
        return isinstance(value, (int, np.integer)) and not isinstance(value, bool) and abs(value) < 2**63
    if name == "detections":
        if isinstance(value, (list, tuple)):
            return len(value) == 0
        return isinstance(value, np.ndarray) and (value.size == 0 or (value.shape[1:] == (6,) and value.size < 100 and not value.any() and value.dtype.kind in "fiu"))
    return False


def refused(name: str, call: Callable[[], Any]) -> str:
    """Asserts that a call is refused, and that its error names the argument."""
    with pytest.raises((ValueError, TypeError)) as caught:
        call()
    text = str(caught.value)
    assert name in text, text
    assert "defect" not in text, text
    return text


def test_booleans_are_refused_as_stamps() -> None:
    slam = sp.Slam(CAMERA)
    for value in (True, np.True_, np.bool_(False)):
        refused("stamp", lambda: slam.track(value, COLOR, DEPTH))
        refused("depth_stamp", lambda: slam.track(1.0, COLOR, DEPTH, depth_stamp=value))


@settings(max_examples=CASES, deadline=None, suppress_health_check=list(HealthCheck))
@given(name=st.sampled_from(["stamp", "color", "depth", "detections", "depth_stamp"]), value=ANYTHING, mask=st.booleans())
def test_any_frame_argument_is_used_or_refused_by_name(name: str, value: Any, mask: bool) -> None:
    target = MASK if mask else SLAM
    method = target.step if mask else target.track
    # Stamps must ascend: this one is later than all others.
    arguments: dict[str, Any] = {"stamp": 1e10, "color": COLOR, "depth": DEPTH, name: value}
    if usable(name, value):
        return
    refused(name, lambda: method(**arguments))


SLAM = sp.Slam(CAMERA)
MASK = sp.DynamicMask(CAMERA)


@settings(max_examples=CASES // 4, deadline=None, suppress_health_check=list(HealthCheck))
@given(value=ANYTHING, name=st.sampled_from(["camera", "config", "detector", "color_order", "dense", "pose", "pixels", "truth", "estimate", "rate"]))
def test_any_other_argument_is_used_or_refused_by_name(name: str, value: Any) -> None:
    calls: dict[str, Callable[[], Any]] = {
        "camera": lambda: sp.Slam(value),
        "config": lambda: sp.Slam(CAMERA, value),
        "detector": lambda: sp.Slam(CAMERA, None, value),
        "color_order": lambda: sp.Slam(CAMERA, color_order=value),
        "dense": lambda: sp.Slam(CAMERA, dense=value),
        "pose": lambda: sp.DynamicMask(CAMERA).step(0.0, COLOR, DEPTH, pose=value),
        "pixels": lambda: MASK.verdicts(value),
        "truth": lambda: sp.evaluate(value, sp.Trajectory([0.0], [np.eye(4)])),
        "estimate": lambda: sp.evaluate(sp.Trajectory([0.0], [np.eye(4)]), value),
        "rate": lambda: sp.simulate("xyz", 1, rate=value),
    }
    try:
        calls[name]()
    except (ValueError, TypeError, FileNotFoundError) as e:
        assert name in str(e), (name, value, e)
        assert "defect" not in str(e), e


@settings(max_examples=CASES // 4, deadline=None, suppress_health_check=list(HealthCheck))
@given(values=st.lists(ANYTHING, min_size=6, max_size=6))
def test_constructors_accept_or_refuse_any_value(values: list[Any]) -> None:
    for make in (lambda: sp.Camera(*values), lambda: sp.Detection(*values[:3]), lambda: sp.Trajectory(*values[:2]), lambda: sp.Config(values[0]),
                 lambda: sp.Camera.from_k(*values[:3]), lambda: sp.Camera.from_info(values[0]),
                 lambda: sp.Camera.from_info({"width": values[0], "height": values[1], "K": values[2], "D": values[3]})):  # fmt: skip
        try:
            make()
        except (ValueError, TypeError) as e:
            assert str(e) and "defect" not in str(e), e


@pytest.mark.parametrize("flip", range(6))
def test_strides_do_not_matter(flip: int) -> None:
    color, depth = [
        (COLOR, DEPTH),
        (np.asfortranarray(COLOR), np.asfortranarray(DEPTH)),
        (np.repeat(np.repeat(COLOR, 2, 0), 3, 1)[::2, ::3], np.repeat(np.repeat(DEPTH, 2, 0), 3, 1)[::2, ::3]),
        (COLOR[::-1, ::-1].copy()[::-1, ::-1], DEPTH[::-1].copy()[::-1]),
        (np.ascontiguousarray(COLOR.transpose(2, 1, 0)).transpose(2, 1, 0), structured()),
        (np.pad(COLOR, ((3, 1), (2, 2), (0, 1)))[3:-1, 2:-2, :3], np.broadcast_to(np.uint16(2000), (48, 64))),
    ][flip]
    for array in (color, depth):
        if array.flags.owndata or flip:
            array.flags.writeable = False
    reference = sp.Slam(CAMERA).track(0.0, COLOR.copy(), DEPTH.copy())
    frame = sp.Slam(CAMERA).track(0.0, color, depth)
    assert np.array_equal(frame.gray, reference.gray) and np.array_equal(frame.depth, reference.depth)
    assert np.all(frame.depth == 2.0)


def test_a_refused_frame_changes_nothing() -> None:
    room = sp.simulate("xyz", frames=6)
    images = list(room)
    texts = []
    for disturbed in (False, True):
        slam = sp.Slam(room.camera)
        for i in images:
            if disturbed:
                for bad in (np.nan, None, "now", images[0].stamp - 1 if i.index else np.inf):
                    refused("stamp", lambda: slam.track(bad, i.color, i.depth))
                refused("color", lambda: slam.track(i.stamp, i.color[1:], i.depth))
                refused("depth", lambda: slam.track(i.stamp, i.color, i.depth.astype(np.int32)))
            slam.track(i.stamp, i.color, i.depth, depth_stamp=i.depth_stamp)
        slam.finish()
        texts.append(slam.trajectory().to_tum())
    # Stamps that go back twice in a row indicate a clock that was set back; once is an error.
    assert texts[0] == texts[1]


def test_invalid_depths_become_zero() -> None:
    depth = DEPTH.astype(np.float32) / 1000
    depth[0, :6] = [np.nan, np.inf, -np.inf, -1.0, 0.0, 1e-30]
    frame = sp.Slam(CAMERA).track(0.0, COLOR, depth)
    assert np.array_equal(frame.depth[0, :5], np.zeros(5)) and frame.depth[1, 0] == 2.0
    raw = DEPTH.copy()
    raw[0, :2] = [0, 65535]
    assert np.array_equal(sp.Slam(CAMERA).track(0.0, COLOR, raw).depth[0, :2], [0.0, 0.0])


def test_stamps_are_seconds_or_nanoseconds() -> None:
    for stamp, seconds in [
        (1305031102.175304, 1305031102.175304),
        (1305031102175304000, 1305031102.175304),
        (np.int64(1305031102175304000), 1305031102.175304),
        (np.float32(0.5), 0.5),
        (np.float64(0.25), 0.25),
        (0, 0.0),
        (-1_500_000_000, -1.5),
    ]:
        assert sp.Slam(CAMERA).track(stamp, COLOR, DEPTH).stamp == seconds


def test_invalid_detections_are_reported_by_name() -> None:
    slam = sp.Slam(CAMERA, detector=lambda image: "nothing")
    refused("detector", lambda: slam.track(0.0, COLOR, DEPTH))

    def fails(image: np.ndarray) -> None:
        raise KeyError("mine")

    slam = sp.Slam(CAMERA, detector=fails)
    with pytest.raises(KeyError, match="mine"):
        slam.track(0.0, COLOR, DEPTH)
    # The frame was not tracked, so its stamp is unused.
    slam = sp.Slam(CAMERA, detector=lambda image: None)
    refused("detector", lambda: slam.track(0.0, COLOR, DEPTH))
    text = refused("detections[1]", lambda: SLAM.track(0.0, COLOR, DEPTH, [(0, 0, 9, 9, 0.5, 0), (0, 0, 9, 9, 7, 0)]))
    assert "score" in text
    refused("class_name", lambda: sp.Detection("persn", 0.5, (0, 0, 1, 1)))
    assert "person" in refused("class_name", lambda: sp.Detection("persn", 0.5, (0, 0, 1, 1)))


def test_presets_without_a_size_and_tiny_images_are_refused() -> None:
    refused("camera", lambda: sp.Slam(sp.Camera(8, 8, 9.0, 9.0, 3.5, 3.5)))
    refused("camera", lambda: sp.DynamicMask(sp.Camera(8, 8, 9.0, 9.0, 3.5, 3.5)))
    refused("camera", lambda: sp.Slam("no_such_preset"))
    refused("camera", lambda: sp.Slam(sp.Camera(65536, 65536, 9e4, 9e4, 3e4, 3e4)))
