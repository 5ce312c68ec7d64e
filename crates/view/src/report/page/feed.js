"use strict";
// The page of a live run: receives updates, and limits its redraw rate to leave the CPU to the run.

/// Minimum time between redraws, ms. Software rendering takes a core from the run.
const PACE = { frame: 60, numbers: 400, timeline: 500, map: 700 };

const feed = { updates: 0, state: "waiting", dirty: new Set(), painted: {}, rates: [], waiting: false };

function tell(state, text) {
  feed.state = state;
  say(state, text);
}

function startLive() {
  prepare();
  follow(true);
  byId("live").hidden = false;
  inReport(false);
  tell("waiting", "Waiting for the first frame.");
  const source = new EventSource("events");
  source.addEventListener("update", (e) => take(JSON.parse(e.data)));
  source.addEventListener("report", (e) => finish(source, new Run(JSON.parse(e.data)), ""));
  source.addEventListener("end", (e) => finish(source, null, JSON.parse(e.data)));
  source.addEventListener("error", () => {
    if (feed.state !== "over") tell("away", "The connection is lost; it is tried again. What is shown is what was known before.");
  });
  document.addEventListener("visibilitychange", wake);
}

/// Shows or hides sections that only reports have.
function inReport(shown) {
  for (const id of ["worst-section", "tables-section", "stages-section", "layer-truth"]) byId(id).hidden = !shown;
  document.body.classList.toggle("live", !shown);
}

/// Applies an update and schedules the redraws.
function take(update) {
  feed.updates++;
  const before = page.run, at = before && before.count ? before.id[page.frame] : null;
  const fresh = update.about && new LiveRun(update.about), run = fresh || page.run, changed = run.take(update);
  if (fresh) begin(fresh);
  if (!page.following && at !== null) page.frame = run.at(at);
  feed.rates.push([performance.now(), update.now.frames]);
  while (feed.rates.length > 2 && feed.rates[0][0] < performance.now() - 3000) feed.rates.shift();
  feed.dirty.add("frame").add("numbers");
  if (changed.frames) feed.dirty.add("timeline");
  if (changed.map) feed.dirty.add("map");
  if (changed.surface) feed.dirty.add("surface");
  if (changed.marks) feed.dirty.add("marks");
  wake();
}

/// Shows a new, empty run, at the start or after a reconnection.
function begin(run) {
  const view = page.view, first = !page.run;
  page.runs = [run];
  page.run = run;
  page.shownObjects = null;
  byId("title").textContent = run.label;
  document.title = `${run.label} (live) - Stillpoint`;
  byId("subtitle").textContent = run.about.input;
  byId("command").textContent = run.data.command;
  byId("config").textContent = run.data.config;
  page.timeline.load(run);
  if (page.is3d) page.plan.load(run, []);
  if (first) {
    view.load(run, []);
    openAt(location.hash);
    page.ready = true;
  } else if (page.is3d) [view.run, view.others] = [run, []];
  else view.load(run, []);
}

function wake() {
  if (feed.waiting || document.hidden || !page.run) return;
  feed.waiting = true;
  setTimeout(() => requestAnimationFrame(() => {
    feed.waiting = false;
    paintDue();
  }), 15);
}

/// Redraws the changed parts that are due, and schedules the others.
function paintDue() {
  const run = page.run, now = performance.now();
  const turn = (name) => {
    if (!feed.dirty.has(name) || now - (feed.painted[name] || 0) < (PACE[name] || 0)) return false;
    feed.dirty.delete(name);
    feed.painted[name] = now;
    return true;
  };
  if (feed.state === "over" || !run.now) return;
  if (turn("marks")) showMarks(run);
  if (turn("map")) {
    page.view.grow();
    page.plan.grow();
  }
  if (turn("surface")) page.view.growSurface();
  if (turn("timeline")) {
    page.timeline.refresh();
    page.view.paintWay();
    page.plan.paintWay();
  }
  if (turn("numbers")) showNow(run);
  if (turn("frame")) {
    if (page.following) go(run.count - 1);
    else if (run.count) page.timeline.at(page.frame);
  }
  if (feed.dirty.size) wake();
}

/// Shows figures, warnings and the status.
function showNow(run) {
  const now = run.now, m = now.measured, [first, last] = [feed.rates[0], feed.rates[feed.rates.length - 1]];
  const rate = last[0] > first[0] ? 1e3 * (last[1] - first[1]) / (last[0] - first[0]) : NaN;
  fillFigures(liveFigures(run, rate));
  const warnings = [...m.troubles.map((t) => `A thread is in trouble: ${t}.`)];
  if (now.still) warnings.push(`${now.still[0].toUpperCase()}${now.still.slice(1)}.`);
  if (m.silent_s > 1) warnings.push(`No frame for ${fixed(m.silent_s, 0)} s.`);
  showRemarks(warnings);
  if (!now.frames) tell("waiting", "Waiting for the first frame.");
  else if (now.lost) tell("lost", now.loss ? now.loss[0].toUpperCase() + now.loss.slice(1) : "Lost");
  else tell("live", `Live: ${now.state}.`);
}

/// Ends the live page. The report, if there is one, replaces the collected data.
function finish(source, report, text) {
  source.close();
  if (!page.run) return tell("over", "The run has ended.");
  if (report) {
    const at = page.run.count && !page.following ? page.run.id[page.frame] : null;
    report.label = report.name;
    page.runs = [report];
    const view = page.view, camera = page.is3d && view.touched && { ...view.scene };
    inReport(true);
    select(report);
    if (camera) for (const name of ["target", "distance", "yaw", "pitch"]) view.scene[name] = camera[name];
    if (at !== null) go(report.at(at)); else if (page.notable.length) go(page.notable[0][1]);
  } else {
    feed.painted = {};
    paintDue();
  }
  feed.state = "over";
  say(report ? report.data.verdict.concern : "", `The run has ended. ${report ? report.data.verdict.text : text}`);
  document.title = `${page.run.label} - Stillpoint`;
  follow(false);
  byId("live").hidden = true;
}

startLive();
