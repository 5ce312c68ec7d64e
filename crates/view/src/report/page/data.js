"use strict";
// Decodes the page's data: typed arrays of columns.

function bytesOf(text) {
  const raw = atob(text);
  const bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return bytes;
}

const column = {
  u8: (text) => bytesOf(text),
  u16: (text) => new Uint16Array(bytesOf(text).buffer),
  u32: (text) => new Uint32Array(bytesOf(text).buffer),
  f32: (text) => new Float32Array(bytesOf(text).buffer),
};

const STATES = ["lost", "initialised", "tracked", "relocalised", "undecided", "carried"];
const LOST = 0, UNDECIDED = 4;

/// One run. Frames have indices from 0 to count - 1; `at` converts a frame's id to one.
class Run {
  constructor(data) {
    this.data = data;
    this.name = data.name;
    this.summary = data.summary || {};
    const f = data.frames;
    this.firstStamp = f.first_stamp;
    this.id = column.u32(f.id);
    this.count = this.id.length;
    this.seconds = column.f32(f.seconds);
    this.state = column.u8(f.state);
    this.inliers = column.u16(f.inliers);
    for (const name of ["moving", "sigma_mm", "quality", "time_ms", "answer_ms", "error_mm", "pose", "truth"]) this[name] = column.f32(f[name] || "");
    this.indices = new Map();
    this.id.forEach((id, i) => this.indices.set(id, i));
    this.points = column.f32(data.map.position);
    this.pointFrame = column.u32(data.map.frame);
    this.pointStill = column.u8(data.map.stands_still);
    this.setSurface(data.surface || {});
    this.keyframeId = column.u32(data.keyframes.id);
    this.keyframePose = column.f32(data.keyframes.pose);
    this.loops = column.u32(data.keyframes.loops);
    this.marks = data.marks.map((m) => ({ ...m, at: this.at(m.frame) }));
    this.objectsOf = new Map();
    this.tracks = new Map();
    this.addObjects(data.objects);
    this.pictureFrame = column.u32(data.pictures.frame);
    this.pictureAt = Array.from(this.pictureFrame, (id) => this.at(id));
    this.images = new Map();
  }

  setSurface(s) {
    this.data.surface = s;
    this.surface = this.corners(s);
    this.surfaceColour = column.u8(s.colour || "");
    this.triangles = column.u16(s.triangle || "");
  }

  /// Surface vertices, m.
  corners(s) {
    const shares = column.u16(s.position || ""), box = column.f32(s.bounds || ""), out = new Float32Array(shares.length);
    for (let i = 0; i < out.length; i++) out[i] = box[i % 3] + shares[i] / 65535 * box[3 + i % 3];
    return out;
  }

  addObjects(o) {
    const all = { frame: column.u32(o.frame), id: column.u32(o.id), kind: column.u8(o.class), motion: column.u8(o.motion), bounds: column.u16(o.bounds),
      position: column.f32(o.position), size: column.f32(o.size), speed: column.f32(o.speed) };
    for (let i = 0; i < all.id.length; i++) {
      const seen = { frame: all.frame[i], at: this.at(all.frame[i]), id: all.id[i], name: o.classes[all.kind[i]], motion: all.motion[i],
        bounds: all.bounds.subarray(4 * i, 4 * i + 4), position: all.position.subarray(3 * i, 3 * i + 3), size: all.size.subarray(2 * i, 2 * i + 2), speed: all.speed[i] };
      if (!this.objectsOf.has(seen.frame)) this.objectsOf.set(seen.frame, []);
      this.objectsOf.get(seen.frame).push(seen);
      if (!this.tracks.has(seen.id)) this.tracks.set(seen.id, []);
      const track = this.tracks.get(seen.id);
      track.push(seen);
      if (seen.motion === 1 && track.moves === undefined) track.moves = seen.at;
    }
  }

  /// Index of the frame with an id, or of the last one before it.
  at(id) {
    const known = this.indices.get(id);
    if (known !== undefined) return known;
    let low = 0, high = this.count;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.id[middle] <= id) low = middle + 1; else high = middle;
    }
    return Math.max(0, low - 1);
  }

  hasPose(i) { return Number.isFinite(this.pose[7 * i]); }
  hasTruth() { return this.error_mm.some(Number.isFinite) || this.truth.some(Number.isFinite); }

  /// Index of the picture nearest to a frame; -1 if there is none.
  picture(i) {
    const list = this.pictureAt;
    if (!list.length) return -1;
    let low = 0, high = list.length - 1;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (list[middle] < i) low = middle + 1; else high = middle;
    }
    return low > 0 && i - list[low - 1] <= list[low] - i ? low - 1 : low;
  }

  features(picture) { return column.u8(this.data.pictures.features[picture]); }

  /// Returns an image, and calls `loaded` if it is late.
  image(picture, loaded) {
    let image = this.images.get(picture);
    if (!image) {
      image = new Image();
      image.addEventListener("load", () => image.waiting.splice(0).forEach((f) => f()));
      image.waiting = [];
      image.src = "data:image/webp;base64," + this.data.pictures.webp[picture];
      this.images.set(picture, image);
      if (this.images.size > 400) this.images.delete(this.images.keys().next().value);
    }
    if (loaded && !image.complete) image.waiting.push(loaded);
    return image;
  }
}

/// Rotates a vector by a quaternion (x, y, z, w).
function rotated(q, v) {
  const [x, y, z, w] = q, [a, b, c] = v;
  const tx = 2 * (y * c - z * b), ty = 2 * (z * a - x * c), tz = 2 * (x * b - y * a);
  return [a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx];
}
