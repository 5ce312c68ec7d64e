"use strict";
// Figures as text, tables and lists.

const element = (name, properties = {}, ...children) => {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(properties)) {
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else if (key in node && key !== "role") node[key] = value;
    else node.setAttribute(key, value);
  }
  node.append(...children);
  return node;
};
const byId = (id) => document.getElementById(id);
const write = (node, text) => { if (node.textContent !== text) node.textContent = text; };
const fixed = (x, digits) => (Number.isFinite(x) ? x.toFixed(digits) : "-");
const millimetres = (m) => (Number.isFinite(m) ? (1e3 * m).toFixed(1) + " mm" : "-");
const middle = (values) => {
  const sorted = Float64Array.from(values).filter(Number.isFinite).sort();
  return sorted.length ? sorted[sorted.length >> 1] : NaN;
};

/// Length of the trajectory, m.
function wayOf(run) {
  let sum = 0, last = -1;
  for (let i = 0; i < run.count; i++) {
    if (!run.hasPose(i)) continue;
    if (last >= 0) sum += Math.hypot(...[0, 1, 2].map((k) => run.pose[7 * i + k] - run.pose[7 * last + k]));
    last = i;
  }
  return sum;
}

/// The six figures at the top of the page: name, value, remark, and whether it is bad.
function figures(run) {
  const s = run.summary, frames = s.frames ?? run.count, lost = frames - (s.tracked ?? 0), list = [];
  list.push(["Frames with a pose", `${s.tracked ?? "-"} of ${frames}`, lost ? `${lost} without` : "none lost", lost > 0]);
  const final = s.accuracy && s.accuracy.final, rpe = final && final.rpe;
  if (final && final.ate) list.push(["Absolute error (ATE)", millimetres(final.ate.rmse), `largest ${millimetres(final.ate.max)}`]);
  else if (final && final.drift) list.push(["Drift at rest", millimetres(final.drift.rmse), `largest ${millimetres(final.drift.max)}`]);
  else list.push(["Own error, 1 sigma", millimetres(1e-3 * middle(run.sigma_mm)), "no truth known"]);
  if (rpe) list.push([`Relative error, ${rpe.delta}`, millimetres(rpe.translation.rmse), rpe.rotation_deg ? `${fixed(rpe.rotation_deg.rmse, 2)} deg` : ""]);
  else list.push(["Length of the way", `${fixed(wayOf(run), 2)} m`, run.count ? `in ${fixed(run.seconds[run.count - 1], 1)} s` : ""]);
  const tracking = stage(run, "frame"), total = stage(run, "total");
  if (s.live && s.live.latency_ms) list.push(["Latency", `${fixed(s.live.latency_ms.median, 1)} ms`, `99 %: ${fixed(s.live.latency_ms.p99, 0)} ms; ${s.live.dropped} dropped`]);
  else list.push(["Tracking a frame", `${fixed(tracking && tracking.median, 1)} ms`, total ? `whole frame ${fixed(total.median, 1)} ms` : tracking ? `99 %: ${fixed(tracking.p99, 1)} ms` : ""]);
  const f = s.features;
  list.push(["Keypoints that move", f && f.keypoints ? `${fixed(100 * f.dynamic_share, 1)} %` : "-", f && f.keypoints ? `of ${fixed(f.keypoints / frames, 0)} a frame` : ""]);
  list.push(["Landmarks of the map", `${s.landmarks ?? "-"}`, `${s.keyframes ?? "-"} keyframes`]);
  return list;
}

/// Figures that only the tables show.
function moreFigures(run) {
  const s = run.summary, list = [];
  if (s.seconds > 0) list.push(["Speed with reading", `${fixed(s.frames / s.seconds, 1)} frames/s`, `${fixed(s.seconds, 1)} s`]);
  if (s.loops) list.push(["Loops closed", `${s.loops.closed + s.loops.joined}`, `${s.loops.set_aside} candidates set aside`]);
  if (s.undecided) list.push(["Undecided who moves", `${s.undecided} frames`, "at the beginning"]);
  if (s.detector && s.detector.kind !== "none") list.push(["Detector", (s.detector.name || s.detector.kind).split("/").pop(), `answered ${s.detector.frames} times`]);
  if (s.peak_memory_bytes) list.push(["Memory (peak)", `${fixed(s.peak_memory_bytes / 1e6, 0)} MB`, ""]);
  return list;
}

function fillFigures(list) {
  const strip = byId("numbers");
  if (strip.children.length !== list.length) strip.replaceChildren(...list.map(() => element("div", {}, element("dt"), element("dd", {}, element("span"), element("small")))));
  list.forEach(([name, value, remark, bad], i) => {
    const [term, told] = strip.children[i].children;
    write(term, name);
    told.className = bad ? "bad" : "";
    write(told.children[0], value);
    write(told.children[1], remark || "");
  });
}

/// Remarks in addition to the verdict.
function remarks(run) {
  const s = run.summary, list = [];
  for (const l of s.lost || []) list.push(`No pose in frames ${l.first} to ${l.last} (${fixed(l.seconds, 2)} s): ${l.reason}; then ${l.then}.`);
  for (const m of (s.submaps || []).slice(1)) list.push(`${m.frames} frames are in a submap of their own (${m.trajectory}) and are not shown.`);
  if (s.interrupted) list.push("The run was interrupted.");
  if (s.skipped) list.push(`${s.skipped} frames could not be read.`);
  if (s.detector && s.detector.failed_frames) list.push(`The detector failed on ${s.detector.failed_frames} frames.`);
  if (s.detector && s.detector.remark) list.push(s.detector.remark);
  return list;
}

function showRemarks(list) {
  byId("remarks-section").hidden = !list.length;
  byId("warnings").replaceChildren(...list.map((w) => element("li", {}, w)));
}

function table(heads, rows) {
  const cell = (x) => (typeof x === "string" && x.length > 28 ? element("td", { className: "text" }, x) : element("td", {}, x instanceof Node ? x : String(x)));
  return element("div", { className: "scroll" }, element("table", {},
    element("thead", {}, element("tr", {}, ...heads.map((h) => element("th", { scope: "col" }, h)))),
    element("tbody", {}, ...rows.map((r) => element("tr", {}, ...r.map((x) => (x instanceof Node && x.tagName === "TD" ? x : cell(x))))))));
}

/// Shows tables: figures, losses, objects, times. `go` shows a frame.
function showTables(run, go) {
  const s = run.summary, parts = [table(["Figure", "Value", ""], [...figures(run), ...moreFigures(run)].map(([name, value, remark]) => [name, value, remark || ""]))];
  const link = (frame) => element("button", { type: "button", onclick: () => go(run.at(frame)) }, String(frame));
  if ((s.lost || []).length) {
    parts.push(element("h3", {}, "Losses"), table(["First frame", "Last frame", "Seconds", "Reason", "Then"],
      s.lost.map((l) => [link(l.first), l.last, fixed(l.seconds, 2), l.reason, l.then])));
  }
  const tracks = [...run.tracks.values()].filter((t) => t.some((o) => o.motion === 1));
  if (tracks.length) {
    parts.push(element("h3", {}, "What moved"), table(["Object", "First frame", "Last frame", "Pictures", "Median speed, m/s"], tracks.slice(0, 60).map((t) =>
      [`${t[0].name} ${t[0].id}`, link(t[0].frame), t[t.length - 1].frame, t.length, fixed(middle(t.map((o) => o.speed)), 2)])));
  }
  if ((s.timing_ms || []).length) {
    parts.push(element("h3", {}, "Time per stage, ms"), table(["Stage", "Frames", "Median", "95 %", "99 %", "Largest"],
      s.timing_ms.map((t) => [t.stage, t.n, fixed(t.median, 2), fixed(t.p95, 2), fixed(t.p99, 2), fixed(t.max, 2)])));
  }
  byId("tables").replaceChildren(...parts);
}
