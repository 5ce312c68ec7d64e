"use strict";
// A live run: collects updates in the data structures of a finished run.

/// Maximum number of stored pictures; when exceeded, every second one is deleted.
const MOST_PICTURES = 900;
const MOST_LATENCIES = 300;

/// A growing typed array with `width` numbers per item.
class Growing {
  constructor(Type, width = 1) {
    [this.Type, this.width, this.count] = [Type, width, 0];
    this.all = new Type(256 * width);
  }

  push(numbers, from) {
    const { width, count } = this;
    if ((count + 1) * width > this.all.length) {
      const all = new this.Type(2 * this.all.length);
      all.set(this.all);
      this.all = all;
    }
    this.count++;
    this.set(count, numbers, from);
  }

  set(i, numbers, from) {
    for (let k = 0; k < this.width; k++) this.all[i * this.width + k] = numbers[from * this.width + k];
  }

  /// Replaces item i with the last one.
  drop(i) {
    this.count--;
    this.set(i, this.all, this.count);
  }

  /// Filters items by `keep`, in order.
  keep(keep) {
    let kept = 0;
    for (let i = 0; i < this.count; i++) if (keep(i)) this.set(kept++, this.all, i);
    this.count = kept;
  }

  get view() { return this.all.subarray(0, this.count * this.width); }
}

const NOTHING = { classes: [], frame: "", id: "", class: "", motion: "", bounds: "", position: "", size: "", speed: "" };
const FRAME_COLUMNS = { id: "u32", seconds: "f32", state: "u8", inliers: "u16", moving: "f32", sigma_mm: "f32", quality: "f32", time_ms: "f32", pose: "f32" };
const TYPES = { u8: Uint8Array, u16: Uint16Array, u32: Uint32Array, f32: Float32Array };

class LiveRun extends Run {
  constructor(about) {
    super({ name: about.name, summary: {}, verdict: {}, config: about.config, command: about.command, image: [0, 0], time_is: about.time_is, marks: [],
      frames: { first_stamp: 0, id: "", seconds: "", state: "", inliers: "", moving: "", sigma_mm: "", quality: "", time_ms: "", error_mm: "", pose: "", truth: "" },
      map: { count: 0, position: "", frame: "", stands_still: "" }, keyframes: { id: "", pose: "", loops: "" },
      objects: NOTHING, pictures: { size: [0, 0], one_in: 4, frame: "", webp: [], features: [] } });
    this.isLive = true;
    this.about = about;
    this.label = about.name;
    this.now = null;
    this.pictureFrame = [];
    this.pictureAt = [];
    this.frames = {};
    for (const [name, type] of Object.entries(FRAME_COLUMNS)) this.frames[name] = new Growing(TYPES[type], name === "pose" ? 7 : 1);
    this.landmarks = { number: new Growing(Uint32Array), position: new Growing(Float32Array, 3), frame: new Growing(Uint32Array), stands_still: new Growing(Uint8Array) };
    this.slots = new Map();
    this.poses = new Map();
    this.latencies = [];
  }

  /// Applies an update; returns what changed.
  take(update) {
    this.now = update.now;
    const latency = update.now.measured.latency_ms;
    if (latency !== null) {
      this.latencies.push(latency);
      if (this.latencies.length > MOST_LATENCIES) this.latencies.shift();
    }
    const changed = { frames: this.takeFrames(update.frames), map: this.takeMap(update.map) };
    if (update.picture) this.takePicture(update.picture);
    changed.picture = !!update.picture;
    if (update.surface) this.setSurface(update.surface);
    changed.surface = !!update.surface;
    this.marks.push(...update.marks.map((m) => ({ ...m, at: this.at(m.frame) })));
    this.marks.splice(0, Math.max(0, this.marks.length - 500));
    changed.marks = update.marks.length > 0;
    return changed;
  }

  takeFrames(news) {
    const columns = {};
    for (const [name, type] of Object.entries(FRAME_COLUMNS)) columns[name] = column[type](news[name]);
    const removed = new Set(column.u32(news.removed)), all = Object.values(this.frames);
    if (news.whole) all.forEach((c) => { c.count = 0; });
    else if (removed.size) {
      const id = this.frames.id.view.slice();
      all.forEach((c) => c.keep((i) => !removed.has(id[i])));
    }
    const moved = news.whole || removed.size > 0;
    if (moved) {
      this.indices = new Map();
      this.frames.id.view.forEach((id, i) => this.indices.set(id, i));
    }
    for (let k = 0; k < columns.id.length; k++) {
      const known = this.indices.get(columns.id[k]);
      for (const [name, c] of Object.entries(this.frames)) {
        if (known === undefined) c.push(columns[name], k); else c.set(known, columns[name], k);
      }
      if (known === undefined) this.indices.set(columns.id[k], this.frames.id.count - 1);
    }
    this.firstStamp = news.first_stamp;
    this.count = this.frames.id.count;
    for (const name of Object.keys(FRAME_COLUMNS)) this[name] = this.frames[name].view;
    if (moved) this.settle();
    return moved || columns.id.length > 0;
  }

  /// Updates stored frame indices after frames were removed or replaced.
  settle() {
    for (const m of this.marks) m.at = this.at(m.frame);
    this.pictureAt = this.pictureFrame.map((id) => this.at(id));
    for (const track of this.tracks.values()) {
      for (const o of track) o.at = this.at(o.frame);
      const moving = track.find((o) => o.motion === 1);
      track.moves = moving && moving.at;
    }
  }

  takeMap(news) {
    const { number, position, frame, stands_still } = this.landmarks, all = [number, position, frame, stands_still];
    if (news.whole) {
      all.forEach((c) => { c.count = 0; });
      this.slots.clear();
    }
    const removed = column.u32(news.removed), id = column.u32(news.id);
    for (const gone of removed) {
      const slot = this.slots.get(gone);
      if (slot === undefined) continue;
      all.forEach((c) => c.drop(slot));
      this.slots.delete(gone);
      if (slot < number.count) this.slots.set(number.all[slot], slot);
    }
    const [positions, frames, still] = [column.f32(news.position), column.u32(news.frame), column.u8(news.stands_still)];
    for (let k = 0; k < id.length; k++) {
      const slot = this.slots.get(id[k]);
      if (slot === undefined) {
        this.slots.set(id[k], number.count);
        number.push(id, k); position.push(positions, k); frame.push(frames, k); stands_still.push(still, k);
      } else {
        position.set(slot, positions, k); frame.set(slot, frames, k); stands_still.set(slot, still, k);
      }
    }
    [this.points, this.pointFrame, this.pointStill] = [position.view, frame.view, stands_still.view];
    this.data.map.count = news.count;
    return this.takeKeyframes(news.keyframes, news.loops) || news.whole || removed.length > 0 || id.length > 0;
  }

  takeKeyframes(news, loops) {
    if (news.whole) this.poses.clear();
    const removed = column.u32(news.removed), id = column.u32(news.id), pose = column.f32(news.pose);
    for (const gone of removed) this.poses.delete(gone);
    id.forEach((number, k) => this.poses.set(number, pose.subarray(7 * k, 7 * k + 7)));
    if (loops !== null) this.loops = column.u32(loops);
    const changed = news.whole || removed.length > 0 || id.length > 0;
    if (changed) {
      this.keyframeId = Uint32Array.from(this.poses.keys());
      this.keyframePose = new Float32Array(7 * this.poses.size);
      [...this.poses.values()].forEach((p, k) => this.keyframePose.set(p, 7 * k));
    }
    return changed || loops !== null;
  }

  takePicture(news) {
    // After a pause the last one is resent.
    if (this.pictureFrame.length && this.pictureFrame[this.pictureFrame.length - 1] >= news.frame) return;
    const { pictures } = this.data;
    [this.data.image, pictures.size] = [news.image, news.size];
    pictures.webp.push(news.webp);
    pictures.features.push(news.features);
    this.pictureFrame.push(news.frame);
    this.pictureAt.push(this.at(news.frame));
    this.addObjects(news.objects);
    if (this.pictureFrame.length > MOST_PICTURES) this.thin();
  }

  /// Deletes every second picture and its objects.
  thin() {
    const { pictures } = this.data, keep = (_, i) => i % 2 === 1;
    this.pictureFrame.forEach((id, i) => { if (!keep(id, i)) this.objectsOf.delete(id); });
    for (const [id, track] of this.tracks) {
      const kept = track.filter((o) => this.objectsOf.has(o.frame));
      kept.moves = track.moves;
      if (kept.length) this.tracks.set(id, kept); else this.tracks.delete(id);
    }
    [pictures.webp, pictures.features] = [pictures.webp.filter(keep), pictures.features.filter(keep)];
    [this.pictureFrame, this.pictureAt] = [this.pictureFrame.filter(keep), this.pictureAt.filter(keep)];
    this.images.clear();
  }
}

/// The six figures at the top of a live run's page, similar to those of its report.
function liveFigures(run, rate) {
  const now = run.now, list = [], m = now.measured, lost = now.frames - now.posed;
  list.push(["Frames with a pose", `${now.posed} of ${now.frames}`, run.about.frames ? `${run.about.frames} in all` : lost ? `${lost} without` : "none lost", now.lost]);
  list.push(["Own error, 1 sigma", now.sigma_mm === null ? "-" : `${fixed(now.sigma_mm, 1)} mm`, now.undecided ? "undecided who moves" : `quality ${fixed(now.quality, 2)}`, now.lost]);
  list.push(["Speed", `${fixed(rate, 0)} frames/s`, m.latency_ms === null ? "" : `${m.dropped} dropped`]);
  const sorted = [...run.latencies].sort((a, b) => a - b), share = (s) => sorted[Math.floor(s * (sorted.length - 1))];
  list.push(["Latency", `${fixed(share(0.5), 1)} ms`, sorted.length ? `99 %: ${fixed(share(0.99), 0)} ms` : ""]);
  list.push(["Keypoints that move", `${fixed(100 * (1 - now.static_share), 0)} %`, now.detections_age === null ? "" : `detections ${fixed(now.detections_age, 2)} s old`]);
  list.push(["Landmarks of the map", `${now.landmarks}`, `${now.keyframes} keyframes, ${now.loops} loops`]);
  return list;
}
