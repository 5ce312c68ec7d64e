"use strict";
// The page: the selected run and frame, controls and keys.

const page = {
  runs: [], run: null, frame: 0, mover: null, playing: false, following: false, errors: [],
};
window.addEventListener("error", (e) => page.errors.push(e.message));

/// Creates the views (timeline, picture, map) and controls.
function prepare() {
  page.timeline = new Timeline(byId("timeline"), seek);
  page.picture = new FramePicture(byId("picture"));
  try {
    page.view = new View3d(byId("scene"), () => page.view.at(page.frame, page.mover));
  } catch (e) {
    byId("no3d").hidden = false;
    byId("no3d").textContent = `No view in three dimensions: ${e.message}. The way from above is shown in its place; plots and tables are complete.`;
    page.view = new Plan(byId("scene"));
  }
  page.is3d = page.view instanceof View3d;
  page.plan = page.is3d ? new Plan(byId("plan")) : page.view;
  byId("plan").hidden = !page.is3d;
  controls();
  keys();
}

/// Shows a frame that the user selected.
function seek(i) {
  follow(page.run && page.run.isLive && i >= page.run.count - 1);
  go(i);
}

/// Sets whether the page follows the newest frame.
function follow(on) {
  page.following = on;
  byId("live").setAttribute("aria-pressed", String(!!on));
}

/// Applies the options in a URL's hash.
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
  say(run.data.verdict.concern, run.data.verdict.text);
  fillFigures(figures(run));
  showRemarks(remarks(run));
  showStages(run);
  showTables(run, seek);
  byId("command").textContent = run.data.command;
  byId("config").textContent = run.data.config;
  byId("machine").textContent = s.machine ? Object.entries(s.machine).map(([k, v]) => `${k}: ${v}`).join(", ") : "";
  showMarks(run);
  page.timeline.load(run);
  page.view.load(run, page.runs.filter((r) => r !== run));
  if (page.is3d) page.plan.load(run, page.view.others);
  worst(run);
  showNotable(run);
  go(Math.min(page.frame, Math.max(0, run.count - 1)));
}

/// Sets the status line.
function say(state, text) {
  const status = byId("status");
  write(status, text);
  status.className = `status ${state}`;
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
  if (page.is3d) page.plan.at(page.frame);
  showObjects(run, page.frame);
}

/// Lists a frame's objects, those with boxes first.
function showObjects(run, i) {
  const picture = run.picture(i), all = picture >= 0 ? run.objectsOf.get(run.pictureFrame[picture]) || [] : [];
  const here = [...all.filter((o) => isDrawn(o, page.mover)), ...all.filter((o) => !isDrawn(o, page.mover))];
  const key = here.map((o) => `${o.id}:${o.motion}`).join() + page.mover;
  if (page.shownObjects === key) return;
  page.shownObjects = key;
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
  let shown = page.frame;
  const step = (now) => {
    // Playback stops when the user selects another frame or run.
    if (!page.playing || page.run !== run || page.frame !== shown) return play(false);
    let i = page.frame;
    while (i < run.count - 1 && run.seconds[i + 1] <= (now - began) / 1e3) i++;
    if (i !== page.frame) go(i);
    shown = page.frame;
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
  byId("save").addEventListener("click", () => page.run && page.picture.save());
  for (const id of ["verdicts", "boxes"]) byId(id).addEventListener("change", () => page.picture.at(page.run, page.frame, page.mover));
  const repaint = () => {
    if (!page.run) return;
    page.timeline.paint();
    page.view.paint();
    page.plan.paint();
    worst(page.run);
    go(page.frame);
  };
  let waiting = 0;
  window.addEventListener("resize", () => { clearTimeout(waiting); waiting = setTimeout(repaint, 60); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", repaint);
  document.fonts.ready.then(repaint);
  // Prints use light colours and expanded details.
  const printed = document.querySelectorAll("details.printed");
  window.addEventListener("beforeprint", () => {
    document.documentElement.dataset.paper = "light";
    printed.forEach((d) => { [d.was, d.open] = [d.open, true]; });
    repaint();
    if (page.is3d) page.view.scene.draw();
  });
  window.addEventListener("afterprint", () => {
    delete document.documentElement.dataset.paper;
    printed.forEach((d) => { d.open = d.was; });
    repaint();
  });
}

/// Keys that work everywhere on the page, unless the focused element uses them.
function keys() {
  const to = (i) => { play(false); seek(i); };
  document.addEventListener("keydown", (e) => {
    const run = page.run, at = e.target instanceof Element ? e.target : document.body;
    if (!run || !run.count || e.defaultPrevented || e.ctrlKey || e.altKey || e.metaKey || at.closest("select")) return;
    const far = e.shiftKey ? 10 : 1, notable = page.notable || [];
    if (e.key === " ") {
      if (at.closest("button, summary, input")) return;
      // In a live run, space stops and resumes following.
      if (!run.isLive) play(!page.playing); else if (page.following) follow(false); else seek(run.count - 1);
    } else if (e.key === "ArrowLeft") to(page.frame - far);
    else if (e.key === "ArrowRight") to(page.frame + far);
    else if (e.key === "Home") to(0);
    else if (e.key === "End") to(run.count - 1);
    else if (e.key === "o" && notable.length) to((notable.find(([, i]) => i > page.frame) || notable.reduce((a, b) => (b[1] < a[1] ? b : a)))[1]);
    else return;
    e.preventDefault();
  });
  // A click must not move the focus, so that arrows and space keep working.
  document.addEventListener("mousedown", (e) => {
    if (!e.target.closest("button, label, summary, canvas")) return;
    e.preventDefault();
    if (document.activeElement) document.activeElement.blur();
  });
  byId("colouring").addEventListener("change", (e) => e.target.blur());
}

/// The page's state and actions, for tests and scripts.
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
