"""HTML representations for notebooks."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from . import Frame, Map, Run, Score, Slam, Trajectory


def _table(title: str, rows: list[tuple[str, str]]) -> str:
    cells = "".join(f"<tr><th style='text-align:left'>{escape(k)}</th><td style='text-align:left'>{escape(v)}</td></tr>" for k, v in rows)
    return f"<table><caption style='text-align:left'>{escape(title)}</caption>{cells}</table>"


def _path(points: list[tuple[float, float]], color: str, box: tuple[float, float, float]) -> str:
    low_x, low_y, scale = box
    text = " ".join(f"{10 + (x - low_x) * scale:.1f},{10 + (y - low_y) * scale:.1f}" for x, y in points)
    return f"<polyline points='{text}' fill='none' stroke='{color}' stroke-width='1.5'/>"


def _drawing(points: list[tuple[float, float]], color: str = "#1f77b4", size: float = 240.0) -> str:
    """A path as SVG, scaled to its largest extent."""
    if not points:
        return ""
    xs, ys = [p[0] for p in points], [p[1] for p in points]
    extent = max(max(xs) - min(xs), max(ys) - min(ys), 1e-9)
    body = _path(points, color, (min(xs), min(ys), (size - 20) / extent))
    return f"<svg width='{size:.0f}' height='{size:.0f}' style='background:#fff'>{body}</svg>"


def trajectory(this: Trajectory) -> str:
    """Length, duration and path."""
    p = this.positions
    rows = [("poses", str(len(this))), ("length", f"{this.length:.3f} m")]
    if len(this):
        rows.append(("time", f"{this.stamps[0]:.3f} to {this.stamps[-1]:.3f} s"))
    step = max(1, len(this) // 500)
    return _table("Trajectory, x and z", rows) + _drawing([(float(q[0]), -float(q[2])) for q in p[::step]])


def frame(this: Frame) -> str:
    """State and counts."""
    rows = [("state", this.state), ("stamp", f"{this.stamp:.6f} s"), ("health", str(this.health)), ("inliers", str(this.inliers))]
    position = this.position
    if position is not None:
        rows.append(("position", ", ".join(f"{v:.3f}" for v in position) + " m"))
    rows += [("objects", ", ".join(f"{o.class_name} {o.id} ({o.motion})" for o in this.objects) or "none")]
    return _table(f"Frame {this.index}", rows)


def map(this: Map) -> str:
    """Version and sizes."""
    rows = [("version", str(this.version)), ("keyframes", str(len(this.keyframe_ids))), ("landmarks", str(len(this.point_ids)))]
    return _table("Map", rows)


def score(this: Score) -> str:
    """Errors."""
    rows = [("ATE RMSE" if not this.is_fixed else "drift RMSE", f"{1e3 * this.ate_rmse:.2f} mm"), ("pairs", str(this.pairs))]
    if this.rpe_rmse is not None and this.rpe_rotation_deg is not None:
        rows.append(("RPE RMSE", f"{1e3 * this.rpe_rmse:.2f} mm, {this.rpe_rotation_deg:.3f} deg"))
    return _table("Score", rows)


def slam(this: Slam) -> str:
    """Summary and current trajectory."""
    return _table(repr(this).strip("<>"), []) + trajectory(this.trajectory())


def run(this: Run) -> str:
    """Statistics and trajectory."""
    rows = [
        ("frames", str(this.frames)),
        ("with a pose", str(len(this.trajectory))),
        ("lost at the time", str(len(this.lost))),
        ("time", f"{this.seconds:.1f} s, {this.frames / max(this.seconds, 1e-9):.1f} frames per second"),
    ]
    if this.score is not None:
        rows.append(("ATE RMSE", f"{1e3 * this.score.ate_rmse:.2f} mm over {this.score.pairs} pairs"))
    return _table("Run", rows) + trajectory(this.trajectory)
