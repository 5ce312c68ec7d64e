"use strict";
// What every frame was, one band under the other, and where one is.

const KINDS = { loss: "No pose", found: "Found again", begun: "Map began", loop: "Loop closed", revoked: "Beginning taken back" };
const kindColour = (kind) => css({ loss: "--bad", found: "--good", begun: "--accent", loop: "--warm", revoked: "--bad" }[kind]);

class Timeline {
  constructor(canvas, go) {
    this.canvas = canvas;
    this.go = go;
    this.line = byId("now-line");
    const to = (e) => {
      const box = canvas.getBoundingClientRect();
      this.go(Math.round((e.clientX - box.left - this.left) / Math.max(1, box.width - this.left - 8) * (this.run.count - 1)));
    };
    canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); this.held = true; to(e); });
    canvas.addEventListener("pointermove", (e) => this.held && to(e));
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { this.held = false; });
    canvas.addEventListener("keydown", (e) => {
      const step = { ArrowLeft: -1, ArrowRight: 1, ArrowDown: -1, ArrowUp: 1, PageUp: -30, PageDown: 30 }[e.key];
      if (step) this.go(this.frame + step);
      else if (e.key === "Home") this.go(0);
      else if (e.key === "End") this.go(this.run.count - 1);
      else return;
      e.preventDefault();
    });
  }

  load(run) {
    this.run = run;
    this.frame = 0;
    this.refresh();
  }

  /// Takes in what is new of the run.
  refresh() {
    const run = this.run;
    const lanes = [["error_mm", "error", "mm"], ["sigma_mm", "1 sigma", "mm"], ["inliers", "inliers", ""], ["moving", "moving share", "%"], ["time_ms", run.data.time_is || "time", "ms"], ["answer_ms", "detector", "ms"]];
    this.lanes = lanes.filter(([name]) => run[name].some((x) => Number.isFinite(x)));
    // An error tells more than what one expects it to be.
    if (this.lanes.some((l) => l[0] === "error_mm")) this.lanes = this.lanes.filter((l) => l[0] !== "sigma_mm");
    this.canvas.setAttribute("aria-valuemin", "0");
    this.canvas.setAttribute("aria-valuemax", String(Math.max(0, run.count - 1)));
    this.paint();
  }

  /// Draws the bands, once; where one is, is a line above them.
  paint() {
    const { canvas, run } = this, scale = Math.min(2, window.devicePixelRatio || 1);
    const [w, h] = [Math.max(1, canvas.clientWidth), Math.max(1, canvas.clientHeight)];
    [canvas.width, canvas.height] = [w * scale, h * scale];
    const g = canvas.getContext("2d");
    g.scale(scale, scale);
    this.left = w < 480 ? 70 : 108;
    const width = w - this.left - 8, band = 14, top = 20;
    g.font = "12px system-ui, sans-serif";
    g.textBaseline = "middle";
    const n = run.count;
    this.x = (i) => this.left + (n > 1 ? i / (n - 1) : 0.5) * width;
    const colours = [css("--bad"), css("--accent"), css("--good"), css("--accent"), css("--warm")];
    // One stroke for as long as nothing changes.
    for (let i = 0, next; i < n; i = next) {
      for (next = i + 1; next < n && run.state[next] === run.state[i];) next++;
      g.fillStyle = colours[run.state[i]];
      g.fillRect(this.x(i) - 0.5 * width / n, top, Math.max(1, (next - i) * width / n + 0.5), band);
    }
    g.fillStyle = css("--muted");
    g.fillText("state", 4, top + band / 2);
    for (const mark of run.marks) {
      const x = this.x(mark.at);
      g.fillStyle = kindColour(mark.kind);
      g.beginPath();
      g.moveTo(x, top - 2); g.lineTo(x - 5, top - 12); g.lineTo(x + 5, top - 12);
      g.fill();
    }
    const room = (h - top - band - 22) / Math.max(1, this.lanes.length);
    this.lanes.forEach(([name, label, unit], k) => this.lane(g, top + band + 6 + k * room, room - 8, width, run[name], label, unit));
    g.fillStyle = css("--muted");
    g.textBaseline = "alphabetic";
    const seconds = n ? run.seconds[n - 1] : 0;
    for (let k = 0; k <= 4; k++) {
      g.textAlign = ["left", "center", "center", "center", "right"][k];
      g.fillText(`${fixed(seconds * k / 4, 1)} s`, this.left + width * k / 4, h - 4);
    }
    g.textAlign = "left";
    this.at(this.frame);
  }

  lane(g, y, height, width, values, label, unit) {
    const n = values.length, factor = unit === "%" ? 100 : 1;
    // For as long as it is undecided who moves, nothing is known of how good a pose is: those frames would make all others look alike.
    const decided = Float64Array.from(values).filter((v, i) => Number.isFinite(v) && this.run.state[i] < UNDECIDED).sort();
    const sorted = decided.length ? decided : Float64Array.from(values).filter(Number.isFinite).sort();
    // What one frame in a hundred has may go beyond the band.
    const most = Math.max(1e-6, sorted.length ? Math.max(sorted[Math.floor(0.99 * (sorted.length - 1))] * 1.15, sorted[sorted.length >> 1] * 1.5) : 1);
    g.fillStyle = css("--muted");
    g.fillText(label, 4, y + 8);
    g.fillText(`${fixed(factor * most, most * factor < 10 ? 1 : 0)} ${unit}`, 4, y + 23);
    g.strokeStyle = css("--line");
    g.beginPath(); g.moveTo(this.left, y + height); g.lineTo(this.left + width, y + height); g.stroke();
    g.strokeStyle = css("--accent");
    g.lineWidth = 1.2;
    g.beginPath();
    const up = (v) => y + height - Math.min(1, v / most) * height;
    // What only some frames have, as the detector's answers and what was not told in time, is a line from one to the next.
    const sparse = this.run.isLive || sorted.length < n / 2;
    if (n <= width || (sparse && n < 4 * width)) {
      let pen = false;
      for (let i = 0; i < n; i++) {
        if (!Number.isFinite(values[i])) { pen = pen && sparse; continue; }
        if (pen) g.lineTo(this.x(i), up(values[i])); else g.moveTo(this.x(i), up(values[i]));
        pen = true;
      }
    } else {
      for (let c = 0; c < width; c++) {
        let low = Infinity, high = -Infinity;
        for (let i = Math.floor(c / width * n); i < Math.floor((c + 1) / width * n); i++) {
          if (values[i] < low) low = values[i];
          if (values[i] > high) high = values[i];
        }
        if (low <= high) { g.moveTo(this.left + c, up(low) + 0.6); g.lineTo(this.left + c, up(high) - 0.6); }
      }
    }
    g.stroke();
    g.lineWidth = 1;
  }

  at(i) {
    this.frame = i;
    const run = this.run;
    this.line.style.transform = `translateX(${this.x(i)}px)`;
    this.canvas.setAttribute("aria-valuenow", String(i));
    if (run.count) this.canvas.setAttribute("aria-valuetext", `frame ${run.id[i]}, ${STATES[run.state[i]]}, ${fixed(run.seconds[i], 2)} seconds`);
  }
}
