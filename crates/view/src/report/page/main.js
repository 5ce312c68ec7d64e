"use strict";
// The page: which run, which frame, and who is told of it.

const page = {
  runs: [], run: null, frame: 0, mover: null, playing: false, following: false, errors: [],
};
window.addEventListener("error", (e) => page.errors.push(e.message));

/// What shows a frame: the timeline, the picture and the map.
function prepare() {
  page.timeline = new Timeline(byId("timeline"), seek);
  page.picture = new FramePicture(byId("picture"));
  try {
    page.view = new View3d(byId("scene"), () => page.view.at(page.frame, page.mover));
  } catch (e) {
    byId("no3d").hidden = false;
    byId("no3d").textContent = `No view in three dimensions: ${e.message}. The way from above is shown in its place; plots and tables are complete.`;
    byId("scene-help").hidden = true;
    page.view = new Plan(byId("scene"));
  }
  page.is3d = page.view instanceof View3d;
  controls();
}

/// Shows a frame that the user asked for.
function seek(i) {
  follow(page.run && page.run.isLive && i >= page.run.count - 1);
  go(i);
}

/// Whether the newest frame is shown, whichever that is.
function follow(on) {
  page.following = on;
  byId("live").setAttribute("aria-pressed", String(!!on));
}

/// What the address says is to be shown.
function openAt(address) {
  const wanted = new URLSearchParams(address.slice(1));
  if (wanted.has("colour")) { byId("colouring").value = wanted.get("colour"); byId("colouring").dispatchEvent(new Event("change")); }
  if (wanted.has("frame")) seek(page.run.at(Number(wanted.get("frame"))));
  if (wanted.has("mover")) choose(Number(wanted.get("mover")));
  if (wanted.has("view")) page.view.view(wanted.get("view"));
}

function select(run) {
  page.run = run;
  page.mover = null;
  [...byId("runs").children].forEach((b, i) => b.setAttribute("aria-current", String(page.runs[i] === run)));
  byId("title").textContent = run.label;
  const s = run.summary, input = s.input || {};
  byId("subtitle").textContent = [input.layout, input.camera && `camera ${input.camera}`, s.machine && s.machine.stillpoint && `Stillpoint ${s.machine.stillpoint}`].filter(Boolean).join(" - ");
  showFigures(run);
  showTables(run, seek);
  byId("command").textContent = run.data.command;
  byId("config").textContent = run.data.config;
  byId("machine").textContent = s.machine ? Object.entries(s.machine).map(([k, v]) => `${k}: ${v}`).join(", ") : "";
  showMarks(run);
  page.timeline.load(run);
  page.view.load(run, page.runs.filter((r) => r !== run));
  worst(run);
  go(Math.min(page.frame, Math.max(0, run.count - 1)));
}

function showMarks(run) {
  byId("marks").replaceChildren(...run.marks.map((m) => element("li", {}, element("button", { type: "button", title: m.text, onclick: () => seek(m.at) },
    element("i", { style: `background:${kindColour(m.kind)}` }), `${KINDS[m.kind]}: frame ${m.frame}`))));
}

/// Shows a frame.
function go(i) {
  const run = page.run;
  if (!run || !run.count) return;
  page.frame = Math.max(0, Math.min(run.count - 1, i));
  page.timeline.at(page.frame);
  page.picture.at(run, page.frame, page.mover);
  page.view.at(page.frame, page.mover);
  showRow(run, page.frame);
}

/// What is known of a frame, and the objects in it.
function showRow(run, i) {
  const rows = [["State", STATES[run.state[i]]], ["Inliers", run.inliers[i]], ...(run.isLive ? [] : [["Error", `${fixed(run.error_mm[i], 1)} mm`]]), ["Position, 1 sigma", `${fixed(run.sigma_mm[i], 1)} mm`],
    ["Quality", fixed(run.quality[i], 2)], ["Keypoints that move", Number.isFinite(run.moving[i]) ? `${fixed(100 * run.moving[i], 0)} %` : "-"], [run.data.time_is || "Time", `${fixed(run.time_ms[i], 1)} ms`]];
  const body = byId("now").tBodies[0];
  if (body.rows.length !== rows.length) body.replaceChildren(...rows.map(([n]) => element("tr", {}, element("th", { scope: "row" }, n), element("td", {}))));
  const write = (cell, text) => { if (cell.textContent !== text) cell.textContent = text; };
  rows.forEach(([n, v], k) => { write(body.rows[k].cells[0], n); write(body.rows[k].cells[1], String(v)); });
  const picture = run.picture(i), here = picture >= 0 ? run.objectsOf.get(run.pictureFrame[picture]) || [] : [];
  const key = here.map((o) => `${o.id}:${o.motion}`).join() + page.mover;
  if (page.shownObjects === key) return;
  page.shownObjects = key;
  byId("movers-title").hidden = !here.length;
  byId("movers").replaceChildren(...here.map((o) => element("li", {}, element("button", { type: "button", "aria-pressed": String(o.id === page.mover), onclick: () => choose(o.id === page.mover ? null : o.id) },
    element("i", { style: `background:${trackColour(o.id)}` }), `${o.name} ${o.id}${["", ", moves", ", parked"][o.motion]}`))));
}

function choose(id) {
  page.mover = id;
  go(page.frame);
}

function play(on) {
  page.playing = on;
  byId("play").setAttribute("aria-pressed", String(on));
  byId("play").textContent = on ? "Pause" : "Play";
  if (!on) return;
  const run = page.run;
  if (page.frame >= run.count - 1) seek(0);
  follow(false);
  const began = performance.now() - 1e3 * run.seconds[page.frame];
  const step = (now) => {
    if (!page.playing || page.run !== run) return play(false);
    let i = page.frame;
    while (i < run.count - 1 && run.seconds[i + 1] <= (now - began) / 1e3) i++;
    if (i !== page.frame) go(i);
    if (i >= run.count - 1) return play(false);
    requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
}

function controls() {
  document.querySelectorAll("[data-view]").forEach((b) => b.addEventListener("click", () => page.view.view(b.dataset.view)));
  byId("colouring").addEventListener("change", (e) => {
    page.view.colouring = e.target.value;
    if (page.is3d) page.view.paint();
  });
  byId("layers").replaceChildren(...LAYERS.map(([name, label]) => element("label", { id: `layer-${name}` }, element("input", { type: "checkbox", checked: true, onchange: (e) => {
    if (!page.is3d) return;
    page.view.scene.show(name, e.target.checked);
    page.view.redraw();
  } }), label)));
  byId("previous").addEventListener("click", () => seek(page.frame - 1));
  byId("next").addEventListener("click", () => seek(page.frame + 1));
  byId("live").addEventListener("click", () => seek(page.run.count - 1));
  byId("play").addEventListener("click", () => play(!page.playing));
  for (const id of ["verdicts", "boxes"]) byId(id).addEventListener("change", () => page.picture.at(page.run, page.frame, page.mover));
  const repaint = () => {
    if (!page.run) return;
    page.timeline.paint();
    page.view.paint();
    go(page.frame);
  };
  let waiting = 0;
  window.addEventListener("resize", () => { clearTimeout(waiting); waiting = setTimeout(repaint, 60); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", repaint);
  window.addEventListener("beforeprint", repaint);
  window.addEventListener("afterprint", repaint);
}

/// What the page shows, for whoever tests or scripts it.
window.stillpoint = {
  get counts() {
    const run = page.run, posed = run.id.reduce((n, _, i) => n + (run.hasPose(i) ? 1 : 0), 0);
    return { frames: run.count, tracked: posed, keyframes: run.keyframeId.length, landmarks: run.data.map.count, pictures: run.pictureFrame.length, triangles: run.triangles.length / 3 };
  },
  get summary() { return page.run.summary; },
  get state() { return { frame: page.frame, mover: page.mover, is3d: page.is3d, ready: !!page.ready, errors: page.errors, playing: page.playing, following: page.following, live: typeof feed === "undefined" ? null : { state: feed.state, updates: feed.updates } }; },
  get run() { return page.run; },
  go: seek, choose, select: (i) => select(page.runs[i]), view: (name) => page.view.view(name),
};
