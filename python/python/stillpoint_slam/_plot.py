"""Plots by matplotlib, an optional dependency."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from . import Frame, Map, Trajectory


def _axes(ax: Any) -> Any:
    if ax is not None:
        return ax
    try:
        import matplotlib.pyplot as plt
    except ImportError as e:
        raise ImportError("expected matplotlib for plots, found none; install it with: pip install matplotlib") from e
    return plt.subplots()[1]


def _from_above(ax: Any) -> None:
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_xlabel("x (m)")
    ax.set_ylabel("z (m)")


def trajectory(this: Trajectory, truth: Trajectory | None = None, ax: Any = None) -> Any:
    """The path from above; with ground truth, both paths after alignment."""
    ax = _axes(ax)
    estimate = this.positions
    if truth is not None:
        from ._native import evaluate

        score = evaluate(truth, this)
        if not score.is_fixed:
            reference, estimate = score.reference, score.aligned
            ax.plot(reference[:, 0], reference[:, 1], color="0.6", label="truth")
            ax.plot(estimate[:, 0], estimate[:, 1], label=f"estimate, ATE RMSE {1e3 * score.ate_rmse:.1f} mm")
            ax.legend()
            ax.set_aspect("equal", adjustable="datalim")
            ax.set_xlabel("x (m)")
            ax.set_ylabel("y (m)")
            return ax
    ax.plot(estimate[:, 0], estimate[:, 2])
    _from_above(ax)
    return ax


def map(this: Map, ax: Any = None) -> Any:
    """Landmarks and keyframes from above."""
    ax = _axes(ax)
    points, keyframes = this.points, this.keyframes.positions
    ax.scatter(points[:, 0], points[:, 2], s=1, color="0.6", label=f"{len(points)} landmarks")
    ax.plot(keyframes[:, 0], keyframes[:, 2], ".", label=f"{len(keyframes)} keyframes")
    ax.legend()
    _from_above(ax)
    return ax


def frame(this: Frame, ax: Any = None) -> Any:
    """The grey image with its keypoints, dynamic ones in red, and the mask."""
    ax = _axes(ax)
    ax.imshow(this.gray, cmap="gray", vmin=0, vmax=255)
    shade = np.zeros((*this.mask.shape, 4))
    shade[..., 0] = 1.0
    shade[..., 3] = 0.35 * (this.mask > 0)
    ax.imshow(shade)
    pixels, dynamic = this.verdicts.pixels, this.verdicts.dynamic
    ax.scatter(pixels[~dynamic, 0], pixels[~dynamic, 1], s=4, color="tab:green")
    ax.scatter(pixels[dynamic, 0], pixels[dynamic, 1], s=4, color="tab:red")
    ax.set_title(f"frame {this.index}: {this.state}")
    ax.set_axis_off()
    return ax
