"use strict";
// Comparison of several runs.

/// Compared figures: name, digits, unit, value, and whether less (-1), more (1) or neither (0) is better.
const COMPARED = [
  ["Frames with a pose", 1, "%", (s) => 100 * s.tracked / s.frames, 1],
  ["Longest loss", 2, "s", (s) => Math.max(0, ...(s.lost || []).map((l) => l.seconds)), -1],
  ["Absolute error (ATE, RMSE)", 1, "mm", (s) => 1e3 * dig(s, "accuracy.final.ate.rmse"), -1],
  ["Absolute error, largest", 1, "mm", (s) => 1e3 * dig(s, "accuracy.final.ate.max"), -1],
  ["Drift at rest (RMS)", 1, "mm", (s) => 1e3 * dig(s, "accuracy.final.drift.rmse"), -1],
  ["Relative error (RPE, RMSE)", 1, "mm", (s) => 1e3 * dig(s, "accuracy.final.rpe.translation.rmse"), -1],
  ["Relative error of direction", 2, "deg", (s) => dig(s, "accuracy.final.rpe.rotation_deg.rmse"), -1],
  ["Tracking a frame, median", 1, "ms", (s, run) => (stage(run, "frame") || {}).median, -1],
  ["Tracking a frame, 99 %", 1, "ms", (s, run) => (stage(run, "frame") || {}).p99, -1],
  ["Latency, median", 1, "ms", (s) => dig(s, "live.latency_ms.median"), -1],
  ["Frames dropped", 0, "", (s) => dig(s, "live.dropped"), -1],
  ["Speed with reading", 1, "frames/s", (s) => s.frames / s.seconds, 1],
  ["Keypoints that move", 1, "%", (s) => 100 * dig(s, "features.dynamic_share"), 0],
  ["Keyframes", 0, "", (s) => s.keyframes, 0],
  ["Landmarks", 0, "", (s) => s.landmarks, 0],
  ["Loops closed", 0, "", (s) => dig(s, "loops.closed") + dig(s, "loops.joined"), 0],
  ["Memory (peak)", 0, "MB", (s) => s.peak_memory_bytes / 1e6, -1],
];

const dig = (s, path) => path.split(".").reduce((o, name) => (o === undefined || o === null ? undefined : o[name]), s);

/// Shows a figure per row: unit, value of the first run, and of each other run with the difference.
function showComparison(runs) {
  byId("compare-section").hidden = runs.length < 2;
  if (runs.length < 2) return;
  const [first, ...others] = runs, rows = [];
  for (const [name, digits, unit, of, better] of COMPARED) {
    const values = runs.map((r) => of(r.summary, r));
    if (!values.some(Number.isFinite)) continue;
    const row = [name, unit, fixed(values[0], digits)];
    for (const value of values.slice(1)) {
      const by = value - values[0], told = Number(by.toFixed(digits)), sign = better * Math.sign(told);
      row.push(fixed(value, digits), element("td", { className: sign > 0 ? "better" : sign < 0 ? "worse" : "" }, !Number.isFinite(by) ? "-" : told === 0 ? "0" : `${told > 0 ? "+" : "\u2013"}${Math.abs(by).toFixed(digits)}`));
    }
    rows.push(row);
  }
  byId("compare-with").textContent = `Differences are to ${first.label}; green is better, orange worse.`;
  byId("compare").replaceChildren(table(["", "", first.label, ...others.flatMap((r) => [r.label, "difference"])], rows));
}
