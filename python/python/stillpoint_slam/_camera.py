"""Cameras as other libraries describe them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ._native import Camera

_LENSES = ("", "none", "plumb_bob", "brown_conrady", "inverse_brown_conrady", "modified_brown_conrady", "rational_polynomial")


def _get(info: object, *names: str) -> Any:
    """What `info` has under the first of the names, None where it has none of them."""
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
        # No camera has more of any; what pretends to be larger than memory is not copied.
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
    # librealsense says distortion.brown_conrady.
    name = str(model or "").rsplit(".", 1)[-1].lower().replace(" ", "_")
    if not any(k):
        return []
    if name == "inverse_brown_conrady":
        raise ValueError("camera: expected a lens as plumb_bob has it, found inverse_brown_conrady with coefficients; rectify the images")
    if name not in _LENSES or any(k[5:]):
        raise ValueError(f"camera: expected a lens of k1, k2, p1, p2, k3 (plumb_bob), found {name or 'another'} with {k}; rectify the images")
    return k[:5]


def from_info(info: object, depth_scale: float | None = None) -> Camera:
    """The camera that `info` describes; see ``Camera.from_info``."""
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
        fx, fy, cx, cy = k[0], k[4], k[2], k[5]
    else:
        found = [_get(info, *names) for names in (("fx",), ("fy",), ("cx", "ppx"), ("cy", "ppy"))]
        if any(f is None for f in found):
            raise ValueError("camera: expected K, or fx, fy, cx and cy, found neither")
        fx, fy, cx, cy = found
    scale = _get(info, "depth_scale") if depth_scale is None else depth_scale
    return Camera(width, height, fx, fy, cx, cy, distortion=_lens(info) or None, depth_scale=scale)
