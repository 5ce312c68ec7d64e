"use strict";
// The floor plan: map and trajectories from above, and recent paths of people and moving objects.

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

class Plan {
  constructor(canvas) {
    this.canvas = canvas;
    this.ground = document.createElement("canvas");
  }

  load(run, others) {
    [this.run, this.others] = [run, others];
    this.grow();
    this.at(0);
  }

  paint() { this.grow(); }
  paintWay() { this.grow(); }
  grow() { this.key = null; }
  growSurface() {}
  view() {}
  redraw() {}

  /// Fits the scale to the middle 90 % of the points, and to all poses.
  extent() {
    const { run } = this, axes = [[], []], every = 3 * Math.max(1, Math.floor(run.points.length / 3 / 4000));
    for (let i = 0; i < run.points.length; i += every) [0, 2].forEach((k, a) => axes[a].push(run.points[i + k]));
    const ranges = axes.map((values) => {
      const sorted = Float64Array.from(values).filter(Number.isFinite).sort();
      return sorted.length ? [sorted[Math.floor(0.05 * sorted.length)], sorted[Math.floor(0.95 * sorted.length)]] : [Infinity, -Infinity];
    });
    for (let i = 0; i < run.count; i++) {
      for (const at of [run.pose.subarray(7 * i, 7 * i + 3), run.truth.subarray(3 * i, 3 * i + 3)]) {
        if (Number.isFinite(at[0])) [0, 2].forEach((k, a) => { ranges[a] = [Math.min(ranges[a][0], at[k]), Math.max(ranges[a][1], at[k])]; });
      }
    }
    const [[x0, x1], [z0, z1]] = ranges.map((r) => (r[0] <= r[1] ? r : [-0.5, 0.5])), { width, height } = this.ground;
    const scale = 0.9 * Math.min(width / Math.max(0.2, x1 - x0), height / Math.max(0.2, z1 - z0));
    this.scale = scale;
    this.px = (p) => [width / 2 + scale * (p[0] - (x0 + x1) / 2), height / 2 - scale * (p[2] - (z0 + z1) / 2)];
  }

  /// Draws the parts that all frames share.
  paintGround() {
    const { run, ground } = this, g = ground.getContext("2d"), unit = density();
    this.extent();
    g.fillStyle = css("--line");
    const every = 3 * Math.max(1, Math.floor(run.points.length / 3 / 8000));
    for (let i = 0; i < run.points.length; i += every) {
      const [x, y] = this.px(run.points.subarray(i, i + 3));
      g.fillRect(x, y, 1.5 * unit, 1.5 * unit);
    }
    // The wide ground truth stays visible under the estimate.
    this.way(g, run, run.truth, 3, css("--truth"), 5 * unit);
    this.others.forEach((o, k) => this.way(g, o, o.pose, 7, trackColour(k + 1), 1.5 * unit));
    this.way(g, run, run.pose, 7, css("--accent"), 1.6 * unit);
    const metre = [5, 2, 1, 0.5, 0.2, 0.1].find((m) => m * this.scale < 0.35 * ground.width) || 0.1, y = ground.height - 6 * unit;
    g.fillStyle = css("--muted");
    g.fillRect(6 * unit, y, metre * this.scale, 2 * unit);
    g.font = `${10 * unit}px Roboto, sans-serif`;
    g.fillText(`${metre} m`, 6 * unit, y - 3 * unit);
  }

  way(g, run, numbers, width, colour, thick) {
    [g.strokeStyle, g.lineWidth, g.lineJoin, g.lineCap] = [colour, thick, "round", "round"];
    g.beginPath();
    let pen = false;
    for (let i = 0; i < run.count; i++) {
      const at = numbers.subarray(width * i, width * i + 3);
      if (!Number.isFinite(at[0])) { pen = false; continue; }
      if (pen) g.lineTo(...this.px(at)); else g.moveTo(...this.px(at));
      pen = true;
    }
    g.stroke();
  }

  /// Draws a frame: the camera's viewing direction and objects' paths.
  at(i) {
    const { canvas, run, ground } = this, unit = density();
    if (!run || canvas.hidden) return;
    const [w, h] = [canvas.clientWidth, canvas.clientHeight].map((v) => Math.max(1, Math.round(v * unit))), key = `${w}x${h}`;
    if (this.key !== key) {
      [canvas.width, canvas.height, ground.width, ground.height] = [w, h, w, h];
      this.key = key;
      this.paintGround();
    }
    const g = canvas.getContext("2d");
    g.clearRect(0, 0, w, h);
    g.drawImage(ground, 0, 0);
    for (const [id, lines] of pathsAt(run, i, page.mover)) {
      [g.strokeStyle, g.fillStyle, g.lineWidth] = [trackColour(id), trackColour(id), 2 * unit];
      for (const line of lines) {
        g.beginPath();
        line.forEach((o, k) => { const at = this.px(o.position); if (k) g.lineTo(...at); else g.moveTo(...at); });
        g.stroke();
      }
      const last = lines.length ? lines[lines.length - 1].at(-1) : null;
      if (!last || run.seconds[i] - run.seconds[last.at] > APART.seconds) continue;
      g.beginPath();
      g.arc(...this.px(last.position), 4 * unit, 0, 7);
      g.fill();
    }
    if (!run.hasPose(i)) return;
    const pose = run.pose.subarray(7 * i, 7 * i + 7), [x, y] = this.px(pose), ahead = rotated(pose.slice(3, 7), [0, 0, 1]), turn = Math.atan2(-ahead[2], ahead[0]);
    g.fillStyle = css("--bad");
    g.beginPath();
    g.moveTo(x, y);
    g.arc(x, y, 13 * unit, turn - 0.45, turn + 0.45);
    g.fill();
  }
}
