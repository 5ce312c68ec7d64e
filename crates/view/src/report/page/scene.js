"use strict";
// 3D points and lines in WebGL 2. The world has the axes of a camera: x right, y down, z ahead; up on the screen is -y.

const VERTEX = `#version 300 es
layout(location = 0) in vec3 position;
layout(location = 1) in vec4 colour;
uniform mat4 clip_from_world;
uniform float size;
uniform float bead;
out vec4 tint;
void main() {
  gl_Position = clip_from_world * vec4(position, 1.0);
  gl_PointSize = bead > 0.0 ? bead : clamp(size / gl_Position.w, 2.0, 14.0);
  tint = colour;
}`;
const FRAGMENT = `#version 300 es
precision mediump float;
in vec4 tint;
uniform bool is_round;
out vec4 colour;
void main() {
  vec2 off = gl_PointCoord - 0.5;
  if (is_round && dot(off, off) > 0.25) discard;
  colour = tint;
}`;

/// Layers drawn as bands of points: width, px, and depth offset towards the viewer, which puts the estimate on top of the truth.
const BANDS = { truth: [7, 0.002], trajectory: [2.6, 0.004] };

/// Layers that change with the frame, drawn over a cached image of the others. Each frame restores only the region that these layers covered:
/// without a GPU, drawing all points takes ten times as long as copying them, and a copy of the canvas as long as the rest of a frame.
/// As they skip the depth test, points never hide them.
const CHANGING = new Set(["camera", "movers"]);

class Scene {
  /// Throws an error if WebGL 2 is unavailable.
  constructor(canvas) {
    this.canvas = canvas;
    const gl = canvas.getContext("webgl2", { alpha: false, antialias: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("this browser, or its settings, offer no WebGL 2");
    this.gl = gl;
    const program = (vertex, fragment) => {
      const made = gl.createProgram();
      for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
        const shader = gl.createShader(kind);
        gl.shaderSource(shader, text);
        gl.compileShader(shader);
        gl.attachShader(made, shader);
      }
      gl.linkProgram(made);
      if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error("WebGL 2 does not take the program: " + gl.getProgramInfoLog(made));
      return made;
    };
    this.program = program(VERTEX, FRAGMENT);
    this.targets = null;
    this.key = null;
    // The region of the canvas that changing layers last covered.
    this.touched = null;
    this.matrix = gl.getUniformLocation(this.program, "clip_from_world");
    this.size = gl.getUniformLocation(this.program, "size");
    this.isRound = gl.getUniformLocation(this.program, "is_round");
    this.bead = gl.getUniformLocation(this.program, "bead");
    this.pointSize = 4;
    this.layers = new Map();
    this.target = [0, 0, 0];
    this.distance = 3;
    this.yaw = 0;
    this.pitch = 0.5;
    this.follow = null;
  }

  /// Sets a layer: `kind` is points, beads (points of fixed size), lines (pairs), strip or triangles (three indices each, in `corners`); `colours` has four bytes per position.
  set(name, kind, positions, colours, corners = null) {
    const gl = this.gl;
    let layer = this.layers.get(name);
    if (!layer) {
      layer = { array: gl.createVertexArray(), buffers: [gl.createBuffer(), gl.createBuffer(), gl.createBuffer()], shown: true };
      this.layers.set(name, layer);
    }
    layer.kind = kind;
    layer.positions = CHANGING.has(name) ? positions : null;
    layer.count = corners ? corners.length : positions.length / 3;
    gl.bindVertexArray(layer.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, layer.buffers[0]);
    gl.bufferData(gl.ARRAY_BUFFER, positions, gl.DYNAMIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    gl.bindBuffer(gl.ARRAY_BUFFER, layer.buffers[1]);
    gl.bufferData(gl.ARRAY_BUFFER, colours, gl.DYNAMIC_DRAW);
    gl.enableVertexAttribArray(1);
    gl.vertexAttribPointer(1, 4, gl.UNSIGNED_BYTE, true, 0, 0);
    if (corners) {
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, layer.buffers[2]);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, corners, gl.DYNAMIC_DRAW);
    }
    gl.bindVertexArray(null);
    if (!CHANGING.has(name)) this.key = null;
  }

  show(name, shown) {
    if (this.layers.has(name)) this.layers.get(name).shown = shown;
    this.key = null;
  }

  /// The viewer's axes in the world: right, up and back.
  axes() {
    const [cy, sy, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    // At yaw 0 and pitch 0 the viewer looks along z, like the first camera.
    return [[cy, 0, sy], [-sy * sp, -cp, cy * sp], [sy * cp, -sp, -cy * cp]];
  }

  eye() {
    const back = this.axes()[2];
    return this.target.map((t, i) => t + this.distance * back[i]);
  }

  clipFromWorld() {
    const { width, height } = this.canvas;
    const [right, up, back] = this.axes(), eye = this.eye();
    const near = this.distance / 100, far = this.distance * 100;
    const f = 1 / Math.tan(0.45), fx = f * Math.min(1, height / width), fy = fx * width / height;
    const dot = (a) => -(a[0] * eye[0] + a[1] * eye[1] + a[2] * eye[2]);
    const rows = [[...right, dot(right)].map((x) => fx * x), [...up, dot(up)].map((x) => fy * x)];
    const z = [...back, dot(back)];
    rows.push(z.map((x, i) => x * (far + near) / (near - far) + (i === 3 ? 2 * far * near / (near - far) : 0)), z.map((x) => -x));
    return new Float32Array([0, 1, 2, 3].flatMap((c) => rows.map((r) => r[c])));
  }

  draw() {
    const gl = this.gl, canvas = this.canvas;
    const scale = Math.min(2, density());
    const [w, h] = [Math.max(1, Math.round(canvas.clientWidth * scale)), Math.max(1, Math.round(canvas.clientHeight * scale))];
    if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    gl.viewport(0, 0, w, h);
    const paper = rgb("--scene"), matrix = this.clipFromWorld(), size = this.pointSize * scale * this.distance;
    const key = [w, h, size, paper, matrix].join(), whole = [0, 0, w, h];
    if (key !== this.key) {
      if (!this.targets || this.targets.size !== `${w}x${h}`) this.makeTargets(w, h);
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.targets.sampled);
      gl.clearColor(paper[0] / 255, paper[1] / 255, paper[2] / 255, 1);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.enable(gl.DEPTH_TEST);
      gl.depthFunc(gl.LEQUAL);
      this.drawLayers(matrix, size, false);
      gl.bindFramebuffer(gl.READ_FRAMEBUFFER, this.targets.sampled);
      gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, this.targets.drawn);
      gl.blitFramebuffer(...whole, ...whole, gl.COLOR_BUFFER_BIT, gl.NEAREST);
      this.key = key;
      this.touched = whole;
    }
    if (this.touched) {
      gl.bindFramebuffer(gl.READ_FRAMEBUFFER, this.targets.drawn);
      gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
      gl.blitFramebuffer(...this.touched, ...this.touched, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.disable(gl.DEPTH_TEST);
    this.drawLayers(matrix, size, true);
    this.touched = this.reach(matrix, w, h);
  }

  /// Bounding box of the changing layers on the canvas, as left, bottom, right and top, px; null if they are empty.
  reach(matrix, w, h) {
    let box = null;
    for (const name of CHANGING) {
      const layer = this.layers.get(name);
      if (!layer || !layer.shown) continue;
      const p = layer.positions, at = (row, i) => matrix[row] * p[i] + matrix[4 + row] * p[i + 1] + matrix[8 + row] * p[i + 2] + matrix[12 + row];
      for (let i = 0; i < p.length; i += 3) {
        const depth = at(3, i);
        // A vertex behind the viewer has no pixel.
        if (!(depth > 1e-6)) return [0, 0, w, h];
        const [x, y] = [(at(0, i) / depth + 1) / 2 * w, (at(1, i) / depth + 1) / 2 * h];
        box = box ? [Math.min(box[0], x), Math.min(box[1], y), Math.max(box[2], x), Math.max(box[3], y)] : [x, y, x, y];
      }
    }
    if (!box) return null;
    const clamp = (v, most) => Math.max(0, Math.min(most, v));
    return [clamp(Math.floor(box[0]) - 2, w), clamp(Math.floor(box[1]) - 2, h), clamp(Math.ceil(box[2]) + 2, w), clamp(Math.ceil(box[3]) + 2, h)];
  }

  drawLayers(matrix, size, changing) {
    const gl = this.gl;
    gl.useProgram(this.program);
    gl.uniformMatrix4fv(this.matrix, false, matrix);
    gl.uniform1f(this.size, size);
    for (const [name, layer] of this.layers) {
      if (!layer.shown || !layer.count || CHANGING.has(name) !== changing) continue;
      gl.bindVertexArray(layer.array);
      const dots = layer.kind === "points" || layer.kind === "beads", [width, nearer] = BANDS[name] || [0, 0];
      gl.uniform1i(this.isRound, dots ? 1 : 0);
      gl.uniform1f(this.bead, layer.kind === "beads" ? width * density() : 0);
      gl.depthRange(0.005 - nearer, 1 - nearer);
      if (layer.kind === "triangles") gl.drawElements(gl.TRIANGLES, layer.count, gl.UNSIGNED_INT, 0);
      else gl.drawArrays({ points: gl.POINTS, beads: gl.POINTS, lines: gl.LINES, strip: gl.LINE_STRIP }[layer.kind], 0, layer.count);
    }
    gl.bindVertexArray(null);
  }

  /// Creates a multisampled framebuffer, and the one that it resolves to.
  makeTargets(w, h) {
    const gl = this.gl, old = this.targets;
    if (old) {
      [old.sampled, old.drawn].forEach((f) => gl.deleteFramebuffer(f));
      old.buffers.forEach((b) => gl.deleteRenderbuffer(b));
    }
    const samples = Math.min(4, gl.getParameter(gl.MAX_SAMPLES)), sampled = gl.createFramebuffer(), drawn = gl.createFramebuffer();
    const buffers = [[sampled, gl.RGBA8, gl.COLOR_ATTACHMENT0, samples], [sampled, gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT, samples],
      [drawn, gl.RGBA8, gl.COLOR_ATTACHMENT0, 0]].map(([target, format, place, times]) => {
      const buffer = gl.createRenderbuffer();
      gl.bindFramebuffer(gl.FRAMEBUFFER, target);
      gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
      gl.renderbufferStorageMultisample(gl.RENDERBUFFER, times, format, w, h);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, buffer);
      return buffer;
    });
    this.targets = { size: `${w}x${h}`, sampled, drawn, buffers };
  }

  turn(dx, dy) {
    this.yaw += dx;
    this.pitch = Math.max(-1.55, Math.min(1.55, this.pitch + dy));
  }

  move(dx, dy) {
    const [right, up] = this.axes();
    const step = this.distance;
    this.target = this.target.map((t, i) => t - step * (dx * right[i] - dy * up[i]));
  }

  zoom(factor) { this.distance = Math.max(0.05, Math.min(500, this.distance * factor)); }
}

/// A CSS variable's colour as RGB bytes.
const rgb = (name) => hex(css(name));
