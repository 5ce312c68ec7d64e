"use strict";
// Numbers in words, tables and lists.

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
const fixed = (x, digits) => (Number.isFinite(x) ? x.toFixed(digits) : "-");
const millimetres = (m) => (Number.isFinite(m) ? (1e3 * m).toFixed(1) + " mm" : "-");

/// What stands in the head of the page: name, value, remark, and whether it is bad.
function figures(run) {
  const s = run.summary, list = [];
  if (s.frames !== undefined) {
    const lost = s.frames - s.tracked;
    list.push(["Frames with a pose", `${s.tracked} of ${s.frames}`, lost ? `${lost} without` : "none lost", lost > 0]);
  }
  const final = s.accuracy && s.accuracy.final;
  if (final && final.ate) {
    list.push(["Absolute error (ATE, rmse)", millimetres(final.ate.rmse), `largest ${millimetres(final.ate.max)}`]);
    if (final.rpe) {
      const turn = final.rpe.rotation || final.rpe.rotation_deg;
      list.push(["Relative error (RPE, rmse)", millimetres(final.rpe.translation.rmse), turn ? `${fixed(turn.rmse, 2)} deg` : ""]);
    }
  } else if (final && final.drift) {
    list.push(["Drift of a camera at rest", millimetres(final.drift.rmse), `largest ${millimetres(final.drift.max)}`]);
  }
  if (s.seconds > 0) list.push(["Speed", `${fixed(s.frames / s.seconds, 0)} frames/s`, `${fixed(s.seconds, 1)} s with reading`]);
  const stage = (name) => (s.timing_ms || []).find((t) => t.stage === name);
  if (s.live && s.live.latency_ms) list.push(["Latency (median)", `${fixed(s.live.latency_ms.median, 1)} ms`, `99 %: ${fixed(s.live.latency_ms.p99, 1)} ms, ${s.live.dropped} dropped`]);
  else if (stage("frame")) list.push(["Tracking (median)", `${fixed(stage("frame").median, 1)} ms`, `99 %: ${fixed(stage("frame").p99, 1)} ms`]);
  if (s.features && s.features.keypoints) list.push(["Keypoints that move", `${fixed(100 * s.features.dynamic_share, 1)} %`, `${fixed(s.features.keypoints / s.frames, 0)} keypoints per frame`]);
  if (s.keyframes !== undefined) list.push(["Map", `${s.keyframes} keyframes`, `${s.landmarks} landmarks`]);
  if (s.loops) list.push(["Loops closed", `${s.loops.closed + s.loops.joined}`, `${s.loops.set_aside} candidates set aside`]);
  if (s.undecided) list.push(["Undecided who moves", `${s.undecided} frames`, "at the beginning"]);
  if (s.detector && s.detector.kind !== "none") list.push(["Detector", (s.detector.name || s.detector.kind).split("/").pop(), `answered ${s.detector.frames} times`]);
  if (s.peak_memory_bytes) list.push(["Memory (peak)", `${fixed(s.peak_memory_bytes / 2 ** 20, 0)} MB`, ""]);
  return list;
}

function fillFigures(list) {
  byId("numbers").replaceChildren(...list.map(([name, value, remark, bad]) =>
    element("div", {}, element("dt", {}, name), element("dd", { className: bad ? "bad" : "" }, value, element("small", {}, remark || "")))));
}

function showFigures(run) {
  fillFigures(figures(run));
  const s = run.summary, warnings = [];
  for (const l of s.lost || []) warnings.push(`No pose in frames ${l.first} to ${l.last} (${fixed(l.seconds, 2)} s): ${l.reason}; then ${l.then}.`);
  for (const m of (s.submaps || []).slice(1)) warnings.push(`${m.frames} frames are in a submap of their own (${m.trajectory}) and are not shown.`);
  if (s.interrupted) warnings.push("The run was interrupted.");
  if (s.skipped) warnings.push(`${s.skipped} frames could not be read.`);
  if (s.detector && s.detector.failed_frames) warnings.push(`The detector failed on ${s.detector.failed_frames} frames.`);
  byId("warnings").hidden = !warnings.length;
  byId("warnings").replaceChildren(...warnings.map((w) => element("li", {}, w)));
}

function table(heads, rows) {
  const cell = (x) => (typeof x === "string" && x.length > 28 ? element("td", { className: "text" }, x) : element("td", {}, x instanceof Node ? x : String(x)));
  return element("div", { className: "scroll" }, element("table", {},
    element("thead", {}, element("tr", {}, ...heads.map((h) => element("th", { scope: "col" }, h)))),
    element("tbody", {}, ...rows.map((r) => element("tr", {}, ...r.map(cell))))));
}

/// Losses, loops, objects and times as tables. `go` shows a frame.
function showTables(run, go) {
  const s = run.summary, parts = [];
  const link = (frame) => element("button", { type: "button", onclick: () => go(run.at(frame)) }, String(frame));
  if ((s.lost || []).length) {
    parts.push(element("h3", {}, "Losses"), table(["First frame", "Last frame", "Seconds", "Reason", "Then"],
      s.lost.map((l) => [link(l.first), l.last, fixed(l.seconds, 2), l.reason, l.then])));
  }
  const tracks = [...run.tracks.values()].filter((t) => t.some((o) => o.motion === 1));
  if (tracks.length) {
    const speed = (t) => t.map((o) => o.speed).filter(Number.isFinite).sort((a, b) => a - b);
    parts.push(element("h3", {}, "What moved"), table(["Object", "First frame", "Last frame", "Pictures", "Median speed, m/s"], tracks.slice(0, 60).map((t) => {
      const speeds = speed(t);
      return [`${t[0].name} ${t[0].id}`, link(t[0].frame), t[t.length - 1].frame, t.length, fixed(speeds[speeds.length >> 1], 2)];
    })));
  }
  if ((s.timing_ms || []).length) {
    parts.push(element("h3", {}, "Time per stage, ms"), table(["Stage", "Frames", "Median", "95 %", "99 %", "Largest"],
      s.timing_ms.map((t) => [t.stage, t.n, fixed(t.median, 2), fixed(t.p95, 2), fixed(t.p99, 2), fixed(t.max, 2)])));
  }
  if (!parts.length) parts.push(element("p", { className: "small" }, "The result holds no tables."));
  byId("tables").replaceChildren(...parts);
}

/// Several runs beside each other.
function showComparison(runs) {
  byId("compare").hidden = runs.length < 2;
  if (runs.length < 2) return;
  const all = runs.map((r) => new Map(figures(r).map(([name, value, remark]) => [name, remark ? `${value} (${remark})` : value])));
  const names = [...new Set(all.flatMap((m) => [...m.keys()]))];
  byId("compare").replaceChildren(table(["", ...runs.map((r) => r.label)], names.map((n) => [n, ...all.map((m) => m.get(n) || "-")])));
}
