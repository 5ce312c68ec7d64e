"use strict";
// Time per frame: one bar with its stages, and one with the stages of tracking.

const stage = (run, name) => (run.summary.timing_ms || []).find((t) => t.stage === name);

/// Consecutive stages of a frame, and of its tracking. The remaining time is called rest.
const WHOLE = [["frame", "tracking"], ["detect", "detector"], ["map", "mapping"], ["retrace", "retracing"]];
const TRACKING = [["extract", "keypoints"], ["depth", "depth"], ["flow", "flow"], ["motion", "motion"], ["filter", "static filter"], ["match", "matching"], ["pose", "pose"]];

/// The parts of a stage with their mean times per frame, ms; the last is the rest.
function partsOf(run, whole, names) {
  const frames = whole.n, share = (t) => t.mean * t.n / frames;
  const parts = names.map(([name, label]) => [label, stage(run, name)]).filter(([, t]) => t).map(([label, t]) => [label, share(t)]);
  const known = parts.reduce((sum, [, ms]) => sum + ms, 0);
  // Parallel parts may add up to more than the whole stage; the total is then their sum.
  const total = Math.max(whole.mean, known);
  return { total, parts: [...parts, ["rest", total - known]] };
}

function bar({ total, parts }, deep) {
  const shown = parts.filter(([, ms]) => ms > 0.004 * total);
  return [element("div", { className: "bar" }, ...shown.map(([label, ms]) =>
    element("span", { className: label === "rest" ? "rest" : label === deep ? "deep" : "", style: `width:${100 * ms / total}%`, title: `${label}: ${fixed(ms, 2)} ms` }, ms > 0.07 * total ? label : ""))),
  element("p", { className: "small parts" }, ...shown.map(([label, ms]) => element("span", {}, `${label} ${fixed(ms, ms < 1 ? 2 : 1)} ms`)))];
}

/// Shows the bars of a frame and of tracking, equally wide.
function showStages(run) {
  const tracking = stage(run, "frame"), total = stage(run, "total"), whole = total || tracking;
  byId("stages-section").hidden = !whole;
  if (!whole) return;
  const rows = [], head = (text) => element("p", {}, text), inner = tracking && partsOf(run, tracking, TRACKING);
  if (total) {
    const outer = partsOf(run, total, WHOLE);
    rows.push(head(`A frame, without reading and outputs: ${fixed(outer.total, 1)} ms in the mean`), ...bar(outer, "tracking"));
  }
  if (inner) rows.push(head(`${total ? "Inside of it, tracking" : "Tracking"}: ${fixed(inner.total, 1)} ms in the mean`), ...bar(inner, ""));
  rows.push(element("p", { className: "small" }, `${total ? "Frame" : "Tracking"}: median ${fixed(whole.median, 1)} ms, 99 % under ${fixed(whole.p99, 1)} ms, largest ${fixed(whole.max, 1)} ms. At 30 frames/s there are 33.3 ms.`));
  byId("stages").replaceChildren(...rows);
}
