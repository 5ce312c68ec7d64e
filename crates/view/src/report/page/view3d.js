"use strict";
// The map in 3D: layers of a run, viewpoints and mouse control.

const dark = () => matchMedia("(prefers-color-scheme: dark)").matches && !document.documentElement.dataset.paper;
/// Colours from old to new, and from moving to static, with similar contrast on light and dark backgrounds.
const RAMPS = {
  age: { light: [[70, 50, 127], [39, 127, 142], [150, 150, 20]], dark: [[130, 120, 220], [64, 180, 180], [226, 221, 60]] },
  static: { light: [[190, 70, 0], [140, 115, 20], [0, 115, 150]], dark: [[255, 140, 70], [225, 205, 120], [110, 200, 245]] },
};
const hex = (text) => [1, 3, 5].map((i) => parseInt(text.slice(i, i + 2), 16));
/// RGB bytes of an object's colour, darker on light backgrounds.
const trackBytes = (id) => hex(css(`--object-${id % 8}`)).map((v) => Math.round(dark() ? v : 0.68 * v));
const trackColour = (id) => `rgb(${trackBytes(id)})`;

function ramp(name, share) {
  const colours = RAMPS[name][dark() ? "dark" : "light"], x = 2 * Math.max(0, Math.min(1, share));
  const [a, b] = x < 1 ? [colours[0], colours[1]] : [colours[1], colours[2]], t = x < 1 ? x : x - 1;
  return a.map((v, i) => Math.round(v + t * (b[i] - v)));
}

const painted = (count, colour, alpha = 255) => {
  const bytes = new Uint8Array(4 * count);
  for (let i = 0; i < count; i++) bytes.set([...colour, alpha], 4 * i);
  return bytes;
};

/// Edges of a camera's frustum, as pairs of points.
function frustum(pose, size) {
  const centre = Array.from(pose.slice(0, 3)), q = pose.slice(3, 7);
  const corner = (x, y) => rotated(q, [x * size, y * size, 1.2 * size]).map((v, i) => v + centre[i]);
  const c = [corner(-0.8, -0.6), corner(0.8, -0.6), corner(0.8, 0.6), corner(-0.8, 0.6)];
  const out = [];
  for (let i = 0; i < 4; i++) out.push(...centre, ...c[i], ...c[i], ...c[(i + 1) % 4]);
  return out;
}

/// Edges of an upright box, as pairs of points.
function boxEdges(p, w, h) {
  const at = (i) => [p[0] + (i & 1 ? w : -w) / 2, p[1] + (i & 2 ? h : -h) / 2, p[2] + (i & 4 ? w : -w) / 2];
  const out = [];
  for (let i = 0; i < 8; i++) for (const bit of [1, 2, 4]) if (!(i & bit)) out.push(...at(i), ...at(i | bit));
  return out;
}

/// Lines of a ground grid, as pairs of points.
function squares(middle, y, reach, step) {
  const out = [], n = Math.ceil(reach / step), [x0, z0] = [0, 2].map((k) => Math.round(middle[k] / step) * step);
  for (let i = -n; i <= n; i++) {
    out.push(x0 + i * step, y, z0 - n * step, x0 + i * step, y, z0 + n * step);
    out.push(x0 - n * step, y, z0 + i * step, x0 + n * step, y, z0 + i * step);
  }
  return out;
}

/// Maximum gap between connected sightings of an object, s and m; nothing was measured in longer gaps.
const APART = { seconds: 0.5, metres: 0.6 };

/// An object's path in the last seconds before a frame, as lines through its sightings.
function pathOf(run, track, i, seconds) {
  const lines = [];
  let before = null;
  for (const o of track.slice(0, upTo(track, i))) {
    if (!Number.isFinite(o.position[0]) || run.seconds[o.at] < run.seconds[i] - seconds) continue;
    const joined = before && run.seconds[o.at] - run.seconds[before.at] <= APART.seconds && Math.hypot(...[0, 1, 2].map((k) => o.position[k] - before.position[k])) <= APART.metres;
    if (joined) lines[lines.length - 1].push(o); else lines.push([o]);
    before = o;
  }
  return lines;
}

/// Paths to draw: the whole path of the selected object, and the last seconds of people and moving objects.
const RECENT = 5;
function pathsAt(run, i, mover) {
  const out = [];
  for (const [id, track] of run.tracks) {
    if (id === mover) out.push([id, pathOf(run, track, i, Infinity)]);
    else if (track[0].name === "person" || (track[upTo(track, i) - 1] || {}).motion === 1) out.push([id, pathOf(run, track, i, RECENT)]);
  }
  return out;
}

/// Number of sightings of an object up to a frame.
function upTo(track, i) {
  let low = 0, high = track.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (track[middle].at <= i) low = middle + 1; else high = middle;
  }
  return low;
}

const LAYERS = [["surface", "surface"], ["points", "map"], ["keyframes", "keyframes"], ["loops", "loops"], ["trajectory", "way"], ["truth", "truth"], ["movers", "objects"], ["ground", "ground"]];

class View3d {
  constructor(canvas, changed) {
    this.scene = new Scene(canvas);
    this.changed = changed;
    this.colouring = "age";
    this.waiting = false;
    this.mover = null;
    this.listen(canvas);
  }

  /// Shows a run, and the trajectories of the others.
  load(run, others) {
    this.run = run;
    this.others = others;
    this.extent();
    this.paint();
    this.home();
  }

  /// Computes the extent of the middle 90 % of the points, and of the trajectory.
  extent() {
    const run = this.run, axes = [[], [], []];
    const every = Math.max(1, Math.floor(run.points.length / 3 / 5000));
    for (let i = 0; i < run.points.length; i += 3 * every) for (let k = 0; k < 3; k++) axes[k].push(run.points[i + k]);
    const cut = axes.map((a) => Float64Array.from(a.filter(Number.isFinite)).sort());
    const ranges = cut.map((a) => (a.length ? [a[Math.floor(0.05 * a.length)], a[Math.min(a.length - 1, Math.floor(0.95 * a.length))]] : [-0.5, 0.5]));
    for (let i = 0; i < run.count; i++) {
      if (run.hasPose(i)) for (let k = 0; k < 3; k++) {
        const x = run.pose[7 * i + k];
        ranges[k] = [Math.min(ranges[k][0], x), Math.max(ranges[k][1], x)];
      }
    }
    this.middle = ranges.map(([a, b]) => (a + b) / 2);
    this.radius = Math.max(0.3, Math.hypot(...ranges.map(([a, b]) => b - a)) / 2);
    this.bottom = ranges[1][1];
    // Small and large maps cover about as many pixels.
    this.scene.pointSize = Math.max(3, Math.min(9, 4 * Math.sqrt(3000 / Math.max(1, run.points.length / 3))));
    this.step = [0.1, 0.5, 1, 5, 10].find((s) => this.radius / s < 8) || 50;
  }

  /// Redraws all layers: colours depend on the theme.
  paint() {
    const scene = this.scene;
    this.paintSurface();
    this.colourPoints();
    this.paintKeyframes();
    this.paintWay();
    this.others.forEach((other, k) => {
      const line = this.way(other, (i) => other.pose.subarray(7 * i, 7 * i + 3));
      scene.set("other" + k, "lines", line, painted(line.length / 3, trackBytes(k + 1)));
    });
    for (let k = this.others.length; scene.layers.has("other" + k); k++) scene.show("other" + k, false);
    this.legend();
    this.redraw();
  }

  /// Sets the surface in its own colours, shaded as if lit from above.
  paintSurface() {
    const { surface, surfaceColour, triangles } = this.run, normals = new Float32Array(surface.length);
    for (let t = 0; t < triangles.length; t += 3) {
      const [a, b, c] = [3 * triangles[t], 3 * triangles[t + 1], 3 * triangles[t + 2]];
      const [ux, uy, uz] = [0, 1, 2].map((k) => surface[b + k] - surface[a + k]), [vx, vy, vz] = [0, 1, 2].map((k) => surface[c + k] - surface[a + k]);
      const n = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
      for (const i of [a, b, c]) for (let k = 0; k < 3; k++) normals[i + k] += n[k];
    }
    const bytes = new Uint8Array(4 * surface.length / 3);
    for (let i = 0; i < surface.length; i += 3) {
      const [x, y, z] = [normals[i], normals[i + 1], normals[i + 2]], length = Math.hypot(x, y, z) || 1;
      const light = 0.8 + 0.2 * (0.3 * x - 0.9 * y - 0.3 * z) / length;
      for (let k = 0; k < 3; k++) bytes[4 * i / 3 + k] = light * surfaceColour[i + k];
      bytes[4 * i / 3 + 3] = 255;
    }
    this.scene.set("surface", "triangles", surface, bytes, Uint32Array.from(triangles));
    byId("layer-surface").hidden = !triangles.length;
  }

  /// Shows a new surface.
  growSurface() {
    this.paintSurface();
    this.legend();
    this.redraw();
  }

  /// Sets keyframes, loop closures and the ground.
  paintKeyframes() {
    const { run, scene } = this;
    const muted = rgb("--muted"), warm = rgb("--warm");
    const frames = [];
    for (let i = 0; i < run.keyframeId.length; i++) frames.push(...frustum(run.keyframePose.subarray(7 * i, 7 * i + 7), this.radius / 60));
    scene.set("keyframes", "lines", new Float32Array(frames), painted(frames.length / 3, muted));
    const ground = squares(this.middle, this.bottom, this.radius, this.step);
    scene.set("ground", "lines", new Float32Array(ground), painted(ground.length / 3, rgb("--line")));
    const where = new Map();
    run.keyframeId.forEach((id, i) => where.set(id, run.keyframePose.subarray(7 * i, 7 * i + 3)));
    const loops = [];
    for (let i = 0; i + 1 < run.loops.length; i += 2) {
      const [a, b] = [where.get(run.loops[i]), where.get(run.loops[i + 1])];
      if (a && b) loops.push(...a, ...b);
    }
    scene.set("loops", "lines", new Float32Array(loops), painted(loops.length / 3, warm));
  }

  /// Trajectory and truth.
  paintWay() {
    const { run, scene } = this;
    const way = this.beads(this.way(run, (i) => run.pose.subarray(7 * i, 7 * i + 3)));
    scene.set("trajectory", "beads", way, painted(way.length / 3, rgb("--accent")));
    // The wide ground truth stays visible under the estimate.
    const truth = this.beads(this.way(run, (i) => run.truth.subarray(3 * i, 3 * i + 3)));
    scene.set("truth", "beads", truth, painted(truth.length / 3, rgb("--truth")));
    byId("layer-truth").hidden = !truth.length;
  }

  /// Points along lines, dense enough to form a band: WebGL lines are one pixel wide.
  beads(lines) {
    const out = [], apart = this.radius / 130;
    for (let i = 0; i < lines.length; i += 6) {
      const step = [0, 1, 2].map((k) => lines[i + 3 + k] - lines[i + k]), n = Math.min(1000, Math.max(1, Math.ceil(Math.hypot(...step) / apart)));
      for (let j = 0; j <= n; j++) out.push(...step.map((d, k) => lines[i + k] + d * j / n));
    }
    return new Float32Array(out);
  }

  /// Line segments through the frames, with gaps at missing positions. Steps too short to see are skipped: the trajectory of ten minutes would take
  /// longer to draw than all else.
  way(run, at) {
    const out = [], least = this.radius / 250;
    let from = null, last = null;
    for (let i = 0; i < run.count; i++) {
      const to = at(i);
      if (Number.isFinite(to[0]) && from) {
        const far = Math.hypot(to[0] - from[0], to[1] - from[1], to[2] - from[2]) >= least;
        if (far) out.push(...from, ...to);
        [from, last] = [far ? to : from, far ? null : to];
      } else {
        if (last) out.push(...from, ...last);
        [from, last] = [Number.isFinite(to[0]) ? to : null, null];
      }
    }
    if (last) out.push(...from, ...last);
    return new Float32Array(out);
  }

  colourPoints() {
    const run = this.run, count = run.points.length / 3;
    const last = run.count ? run.id[run.count - 1] : 1, bytes = new Uint8Array(4 * count);
    const steps = Array.from({ length: 64 }, (_, i) => ramp(this.colouring, i / 63));
    for (let i = 0; i < count; i++) {
      const share = this.colouring === "age" ? run.pointFrame[i] / Math.max(1, last) : run.pointStill[i] / 255;
      bytes.set(steps[Math.round(63 * Math.min(1, share))], 4 * i);
      bytes[4 * i + 3] = 255;
    }
    this.scene.set("points", "points", run.points, bytes);
  }

  legend() {
    const run = this.run, text = this.colouring === "age" ? ["first seen early", "late"] : ["seems to move", "stands still"];
    const key = (colour, shape, label) => [element("i", { className: `key ${shape}`, style: `background:${colour}` }), label];
    const parts = [...key(css("--accent"), "line", "way"), ...(run.truth.some(Number.isFinite) ? key(css("--truth"), "line wide", "truth") : [])];
    this.others.forEach((o, k) => parts.push(...key(trackColour(k + 1), "line", o.label)));
    parts.push(...key(`rgb(${ramp(this.colouring, 0)})`, "", text[0]), ...key(`rgb(${ramp(this.colouring, 1)})`, "", text[1]), `; squares: ${this.step} m`);
    const shown = run.points.length / 3;
    if (shown < run.data.map.count) parts.push(`; ${shown} of ${run.data.map.count} landmarks`);
    if (run.triangles.length && run.triangles.length / 3 < run.data.surface.count) parts.push(`; ${run.triangles.length / 3} of ${run.data.surface.count} triangles`);
    byId("legend").replaceChildren(...parts);
  }

  /// Sets a frame's layers: camera and moving objects.
  at(i, mover) {
    const run = this.run, scene = this.scene;
    const camera = run.hasPose(i) ? frustum(run.pose.subarray(7 * i, 7 * i + 7), this.radius / 18) : [];
    scene.set("camera", "lines", new Float32Array(camera), painted(camera.length / 3, rgb("--bad")));
    const picture = run.picture(i), corners = [], colours = [];
    const add = (edges, colour) => {
      corners.push(...edges);
      for (let k = 0; k < edges.length / 3; k++) colours.push(...colour, 255);
    };
    const here = picture >= 0 ? run.objectsOf.get(run.pictureFrame[picture]) || [] : [];
    for (const o of here) {
      if (!Number.isFinite(o.position[0]) || !(o.motion === 1 || o.id === mover)) continue;
      const [w, h] = Number.isFinite(o.size[0]) ? o.size : [0.4, 0.4];
      add(boxEdges(o.position, w, h), o.id === mover ? rgb("--ink") : trackBytes(o.id));
    }
    for (const [id, lines] of pathsAt(run, i, mover)) {
      const colour = id === mover ? rgb("--ink") : trackBytes(id);
      for (const line of lines) for (let k = 1; k < line.length; k++) add([...line[k - 1].position, ...line[k].position], colour);
    }
    scene.set("movers", "lines", new Float32Array(corners), new Uint8Array(colours));
    if (this.following && run.hasPose(i)) this.behind(i);
    this.redraw();
  }

  behind(i) {
    const pose = this.run.pose.subarray(7 * i, 7 * i + 7), ahead = rotated(pose.slice(3, 7), [0, 0, 1]);
    const s = this.scene;
    s.yaw = Math.atan2(-ahead[0], ahead[2]);
    s.pitch = Math.max(-1.5, Math.min(1.5, 0.25 + Math.asin(Math.max(-1, Math.min(1, ahead[1])))));
    s.distance = this.radius * 0.9;
    s.target = ahead.map((a, k) => pose[k] + 0.45 * this.radius * a);
  }

  home() { this.view("home"); }

  /// Redraws a grown map, and keeps all of it in view until the user changes the viewpoint.
  grow() {
    this.extent();
    this.colourPoints();
    this.paintKeyframes();
    this.legend();
    if (!this.touched) this.view("home");
    this.redraw();
  }

  view(name) {
    const s = this.scene;
    this.following = name === "follow" && !this.following;
    this.touched = name !== "home";
    if (name !== "follow") {
      s.target = [...this.middle];
      s.distance = 1.75 * this.radius;
      [s.yaw, s.pitch] = { home: [0.35, 0.55], top: [0, 1.55], side: [-Math.PI / 2, 0.05] }[name];
    }
    document.querySelector("[data-view=follow]").setAttribute("aria-pressed", String(this.following));
    this.changed();
  }

  redraw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.scene.draw();
      this.drawn = (this.drawn || 0) + 1;
    });
  }

  listen(canvas) {
    const held = new Map(), s = this.scene;
    canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); held.set(e.pointerId, [e.clientX, e.clientY]); });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => held.delete(e.pointerId));
    canvas.addEventListener("pointermove", (e) => {
      const before = held.get(e.pointerId);
      if (!before) return;
      this.touched = true;
      const size = Math.max(1, canvas.clientHeight), [dx, dy] = [(e.clientX - before[0]) / size, (e.clientY - before[1]) / size];
      if (held.size === 1) {
        if (e.shiftKey || e.button === 2 || e.buttons & 6) s.move(dx, -dy); else s.turn(3 * dx, 3 * dy);
      } else {
        const other = [...held].find(([id]) => id !== e.pointerId)[1];
        const apart = (p) => Math.max(8, Math.hypot(p[0] - other[0], p[1] - other[1]));
        s.zoom(apart(before) / apart([e.clientX, e.clientY]));
        s.move(dx / 2, -dy / 2);
      }
      held.set(e.pointerId, [e.clientX, e.clientY]);
      this.redraw();
    });
    canvas.addEventListener("contextmenu", (e) => e.preventDefault());
    canvas.addEventListener("wheel", (e) => { e.preventDefault(); this.touched = true; s.zoom(Math.exp(e.deltaY / 600)); this.redraw(); }, { passive: false });
    canvas.addEventListener("keydown", (e) => {
      const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[e.key];
      const view = { 1: "home", 2: "top", 3: "side" }[e.key];
      if (step && e.shiftKey) s.move(-0.08 * step[0], 0.08 * step[1]);
      else if (step) s.turn(0.1 * step[0], 0.1 * step[1]);
      else if (e.key === "+" || e.key === "=") s.zoom(0.85);
      else if (e.key === "-") s.zoom(1 / 0.85);
      else if (view) this.view(view);
      else return;
      this.touched = view !== "home";
      e.preventDefault();
      this.redraw();
    });
  }
}
