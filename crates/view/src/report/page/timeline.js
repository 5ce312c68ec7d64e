"use strict";
// The timeline: lanes with every frame's state and figures.

const KINDS = { loss: "No pose", found: "Found again", begun: "Map began", loop: "Loop closed", revoked: "Beginning taken back" };
const kindColour = (kind) => css({ loss: "--bad", found: "--good", begun: "--accent", loop: "--warm", revoked: "--bad" }[kind]);

/// Width of the column beside the lanes for the current values, px.
const RIGHT = 70;

/// Rounds up to a factor times a power of ten: STEPS for the spacing of an axis, ENDS for its upper end.
const [STEPS, ENDS] = [[1, 2, 5, 10], [1, 1.5, 2, 3, 4, 5, 6, 8, 10]];
function roundUp(x, factors) {
  const power = 10 ** Math.floor(Math.log10(x));
  return power * factors.find((f) => f * power >= x * (1 - 1e-9));
}

class Timeline {
  constructor(canvas, go) {
    this.canvas = canvas;
    this.go = go;
    this.line = byId("now-line");
    const to = (e) => {
      const box = canvas.getBoundingClientRect();
      this.go(this.nearest((e.clientX - box.left - this.left) / Math.max(1, box.width - this.left - RIGHT)));
    };
    canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); this.held = true; to(e); });
    canvas.addEventListener("pointermove", (e) => this.held && to(e));
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { this.held = false; });
    canvas.addEventListener("keydown", (e) => {
      const step = { ArrowDown: -1, ArrowUp: 1, PageUp: -30, PageDown: 30 }[e.key];
      if (!step) return;
      this.go(this.frame + step);
      e.preventDefault();
    });
  }

  load(run) {
    this.run = run;
    this.frame = 0;
    this.refresh();
  }

  /// Updates and redraws the lanes.
  refresh() {
    const run = this.run;
    const lanes = [["error_mm", "error", "mm"], ["sigma_mm", "1 sigma", "mm"], ["moving", "moves", "%"], ["time_ms", run.data.time_is === "latency" ? "latency" : "frame", "ms"], ["answer_ms", "detector", "ms"], ["inliers", "inliers", ""]];
    this.lanes = lanes.filter(([name]) => run[name].some((x) => Number.isFinite(x) && (x > 0 || name !== "moving")));
    // The true error is more useful than its estimate.
    if (this.lanes.some((l) => l[0] === "error_mm")) this.lanes = this.lanes.filter((l) => l[0] !== "sigma_mm");
    byId("values").replaceChildren(...this.lanes.map(() => element("span")));
    this.canvas.setAttribute("aria-valuemin", "0");
    this.canvas.setAttribute("aria-valuemax", String(Math.max(0, run.count - 1)));
    this.paint();
  }

  /// Draws the lanes; a separate element marks the frame.
  paint() {
    const { canvas, run } = this, scale = density();
    const [w, h] = [Math.max(1, canvas.clientWidth), Math.max(1, canvas.clientHeight)];
    [canvas.width, canvas.height] = [w * scale, h * scale];
    const g = canvas.getContext("2d");
    g.scale(scale, scale);
    [this.left, this.right] = [104, w - RIGHT];
    const width = w - this.left - RIGHT, band = 10, top = 14, n = run.count;
    const seconds = n ? run.seconds[n - 1] : 0, until = (i) => (i < n ? this.x(i) : this.left + width);
    this.x = (i) => this.left + (seconds > 0 ? run.seconds[i] / seconds : 0.5) * width;
    g.font = "11px Roboto, sans-serif";
    this.axis(g, width, top, h);
    const colours = [css("--bad"), css("--accent"), css("--good"), css("--accent"), css("--warm"), css("--warm")];
    // One rectangle for frames of equal state.
    for (let i = 0, next; i < n; i = next) {
      for (next = i + 1; next < n && run.state[next] === run.state[i];) next++;
      g.fillStyle = colours[run.state[i]];
      g.fillRect(this.x(i), top, Math.max(1, until(next) - this.x(i)), band);
    }
    g.textBaseline = "middle";
    g.fillStyle = css("--muted");
    g.fillText("state", 6, top + band / 2);
    for (const mark of run.marks) {
      const x = this.x(mark.at);
      g.fillStyle = kindColour(mark.kind);
      g.beginPath();
      g.moveTo(x, top - 1); g.lineTo(x - 5, top - 10); g.lineTo(x + 5, top - 10);
      g.fill();
    }
    const first = top + band + 5, room = (h - first - 18) / Math.max(1, this.lanes.length);
    this.lanes.forEach(([name, label, unit], k) => {
      this.lane(g, first + k * room, room - 6, width, name, label, unit);
      byId("values").children[k].style.top = `${first + k * room + (room - 6) / 2 - 9}px`;
    });
    this.at(this.frame);
  }

  /// Time axis with grid lines through all lanes.
  axis(g, width, top, h) {
    const run = this.run, seconds = run.count ? run.seconds[run.count - 1] : 0;
    if (!(seconds > 0)) return;
    const step = roundUp(seconds / Math.max(2, width / 110), STEPS), digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    g.textAlign = "center";
    g.textBaseline = "alphabetic";
    for (let t = 0; t <= seconds * (1 + 1e-9); t += step) {
      const x = this.left + t / seconds * width;
      g.strokeStyle = css("--line");
      g.beginPath(); g.moveTo(x, top); g.lineTo(x, h - 15); g.stroke();
      g.fillStyle = css("--muted");
      g.fillText(`${t.toFixed(digits)} s`, x, h - 4);
    }
    g.textAlign = "left";
  }

  /// Index of the frame nearest to a share of the duration.
  nearest(share) {
    const { seconds, count } = this.run, t = share * seconds[count - 1];
    let low = 0, high = count - 1;
    while (low < high) {
      const half = (low + high) >> 1;
      if (seconds[half] < t) low = half + 1; else high = half;
    }
    return low > 0 && t - seconds[low - 1] < seconds[low] - t ? low - 1 : low;
  }

  /// Upper end of a lane's scale, the same for all runs of the page to make them comparable.
  most(name) {
    const ends = page.runs.map((run) => {
      // While it is undecided what moves, the quality of poses is unknown: these frames would flatten all others.
      const decided = Float64Array.from(run[name]).filter((v, i) => Number.isFinite(v) && run.state[i] < UNDECIDED).sort();
      const sorted = decided.length ? decided : Float64Array.from(run[name]).filter(Number.isFinite).sort();
      // One frame in a hundred may exceed the lane.
      return sorted.length ? Math.max(sorted[Math.floor(0.99 * (sorted.length - 1))], sorted[sorted.length >> 1] * 1.3) : 0;
    });
    return roundUp(Math.max(1e-6, ...ends), ENDS);
  }

  lane(g, y, height, width, name, label, unit) {
    const values = this.run[name], n = values.length, most = unit === "%" ? Math.min(1, this.most(name)) : this.most(name), factor = unit === "%" ? 100 : 1;
    const up = (v) => y + height - Math.min(1, v / most) * height, digits = (v) => (Number.isInteger(Number(v.toPrecision(3))) ? 0 : 1);
    g.fillStyle = css("--muted");
    g.textBaseline = "middle";
    g.fillText(unit ? `${label}, ${unit}` : label, 6, y + height / 2);
    g.textAlign = "right";
    const ticks = height > 34 ? [0, 0.5, 1] : [0, 1];
    for (const share of ticks) {
      const at = up(share * most), value = factor * share * most;
      g.strokeStyle = css("--line");
      g.beginPath(); g.moveTo(this.left - 3, at); g.lineTo(this.left + width, at); g.stroke();
      g.fillText(value.toFixed(digits(value)), this.left - 6, Math.max(y + 4, Math.min(y + height - 3, at)));
    }
    g.textAlign = "left";
    g.strokeStyle = css("--accent");
    g.lineWidth = 1.3;
    g.beginPath();
    // Connects sparse values: the detector's answers, and a live run's values if some were not reported in time.
    const count = values.reduce((c, v) => c + (Number.isFinite(v) ? 1 : 0), 0), sparse = this.run.isLive || count < n / 2;
    if (n <= width || (sparse && n < 4 * width)) {
      let pen = false;
      for (let i = 0; i < n; i++) {
        if (!Number.isFinite(values[i])) { pen = pen && sparse; continue; }
        if (pen) g.lineTo(this.x(i), up(values[i])); else g.moveTo(this.x(i), up(values[i]));
        pen = true;
      }
    } else {
      // Minimum and maximum of the frames in a column of pixels.
      for (let i = 0, pen = false; i < n;) {
        const c = Math.floor(this.x(i) - this.left);
        let low = Infinity, high = -Infinity;
        for (; i < n && Math.floor(this.x(i) - this.left) === c; i++) {
          if (values[i] < low) low = values[i];
          if (values[i] > high) high = values[i];
        }
        if (low > high) { pen = false; continue; }
        if (pen) g.lineTo(this.left + c, up(low)); else g.moveTo(this.left + c, up(low));
        g.lineTo(this.left + c, up(high) - 0.6);
        pen = true;
      }
    }
    g.stroke();
    g.lineWidth = 1;
  }

  at(i) {
    this.frame = i;
    const run = this.run;
    // In a live run the newest frames may not have been drawn yet.
    this.line.style.transform = `translateX(${Math.min(this.x(i), this.right)}px)`;
    this.canvas.setAttribute("aria-valuenow", String(i));
    if (!run.count) return;
    this.canvas.setAttribute("aria-valuetext", `frame ${run.id[i]}, ${STATES[run.state[i]]}, ${fixed(run.seconds[i], 2)} seconds`);
    this.lanes.forEach(([name, , unit], k) => {
      const value = run[name][i] * (unit === "%" ? 100 : 1);
      write(byId("values").children[k], Number.isFinite(value) ? `${fixed(value, name === "inliers" || unit === "%" ? 0 : 1)} ${unit}` : "-");
    });
  }
}
