"""Conversion of other libraries' camera calibrations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ._native import Camera

_LENSES = ("", "none", "plumb_bob", "brown_conrady", "inverse_brown_conrady", "modified_brown_conrady", "rational_polynomial")


def _get(info: object, *names: str) -> Any:
    """The first existing value among the names; None if there is none."""
    for name in names:
        try:
            found = info.get(name) if isinstance(info, Mapping) else getattr(info, name, None)
        except Exception as e:
            raise TypeError(f"camera: expected an object that can be asked for its {name}, found {e!r}") from e
        if found is not None:
            return found
    return None


def _numbers(name: str, found: object) -> list[float]:
    try:
        # No calibration has longer lists; avoids copying huge objects.
        if np.size(found) > 32:  # type: ignore[arg-type]
            raise TypeError("too many")
        array = np.asarray(found)
        if array.dtype.kind not in "fiu":
            raise TypeError("no real numbers")
        return [float(v) for v in array.ravel()]
    except (TypeError, ValueError, MemoryError) as e:
        raise TypeError(f"camera: expected numbers for {name}, found {type(found).__name__}") from e


def _lens(info: object) -> list[float]:
    """k1, k2, p1, p2, k3."""
    given = _get(info, "D", "d", "coeffs", "distortion")
    k = [] if given is None else _numbers("the distortion", given)
    model = _get(info, "distortion_model", "model")
    # Such as librealsense's distortion.brown_conrady.
    name = str(model or "").rsplit(".", 1)[-1].lower().replace(" ", "_")
    if not any(k):
        return []
    if name == "inverse_brown_conrady":
        raise ValueError("camera: expected a lens as plumb_bob has it, found inverse_brown_conrady with coefficients; rectify the images")
    if name not in _LENSES or any(k[5:]):
        raise ValueError(f"camera: expected a lens of k1, k2, p1, p2, k3 (plumb_bob), found {name or 'another'} with {k}; rectify the images")
    return k[:5]


def _read_out(info: object, size: tuple[Any, Any], figures: tuple[Any, ...]) -> tuple[Any, ...]:
    """Width, height, fx, fy, cx, cy of the images, by REP 104: the calibration, binning and region of interest refer to the full sensor image."""
    roi = _get(info, "roi")

    def whole(of: object, name: str) -> int:
        found = None if of is None else _get(of, name)
        value = 0.0 if found is None else sum(_numbers(name, found)[:1])
        if not 0 <= value <= 1 << 15 or value % 1:
            raise ValueError(f"camera: expected a whole number of px for {name}, found {value}")
        return int(value)

    binning = [max(1, whole(info, name)) for name in ("binning_x", "binning_y")]
    corner = [whole(roi, name) for name in ("x_offset", "y_offset")]
    region = [whole(roi, name) for name in ("width", "height")]
    if binning == [1, 1] and not any(corner) and not any(region):
        return (*size, *figures)
    sides = [whole(info, name) for name in ("width", "height")]
    region = [r or max(0, s - c) for r, s, c in zip(region, sides, corner)]
    if any(c + r > s for c, r, s in zip(corner, region, sides)):
        raise ValueError(
            f"camera: expected a region of interest within the size that is stated, {sides[0]} x {sides[1]} px, "
            f"found {region[0]} x {region[1]} px at ({corner[0]}, {corner[1]})"
        )
    fx, fy, cx, cy = _numbers("fx, fy, cx, cy", figures)
    (x, y), (bx, by) = corner, binning
    return (region[0] // bx, region[1] // by, fx / bx, fy / by, (cx - x) / bx, (cy - y) / by)


def from_info(info: object, depth_scale: float | None = None) -> Camera:
    """See ``Camera.from_info``."""
    width, height = _get(info, "width"), _get(info, "height")
    if width is None or height is None:
        raise TypeError(
            "camera: expected a Camera, the name of a preset, a camera file, or an object with width, height and K or fx, fy, cx, cy, "
            f"found {type(info).__name__}"
        )
    matrix = _get(info, "K", "k")
    if matrix is not None:
        k = _numbers("K", matrix)
        if len(k) != 9:
            raise ValueError(f"camera: expected nine numbers for K, found {len(k)}")
        projection = _get(info, "P", "p")
        if not any(k[:6]) and projection is not None:
            # Some drivers only fill in the projection matrix.
            p = _numbers("P", projection)
            k = [*p[:3], *p[4:7], *p[8:11]] if len(p) == 12 else k
        fx, fy, cx, cy = k[0], k[4], k[2], k[5]
    else:
        found = [_get(info, *names) for names in (("fx",), ("fy",), ("cx", "ppx"), ("cy", "ppy"))]
        if any(f is None for f in found):
            raise ValueError("camera: expected K, or fx, fy, cx and cy, found neither")
        fx, fy, cx, cy = found
    width, height, fx, fy, cx, cy = _read_out(info, (width, height), (fx, fy, cx, cy))
    scale = _get(info, "depth_scale") if depth_scale is None else depth_scale
    return Camera(width, height, fx, fy, cx, cy, distortion=_lens(info) or None, depth_scale=scale)
