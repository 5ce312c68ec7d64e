"use strict";
// The frame's picture, with verdicts and boxes.

/// Verdicts on keypoints. As in `--overlay`, static ones are discs, rejected ones rings with a dot.
const SAID = ["stands still", "on a moving object", "moves against the scene", "off its epipolar line", "depth of what moves", "moved before"];
const saidColour = (kind) => css(`--said-${kind}`);
/// Whether the page fills one screen, so that height limits the picture's size as well.
const ONE_SCREEN = matchMedia("(min-width: 60rem), print");
/// Device pixels per CSS pixel, at most 3; keeps canvases sharp on dense screens.
const density = () => Math.min(3, window.devicePixelRatio || 1);

class FramePicture {
  constructor(canvas) {
    this.canvas = canvas;
    byId("said").replaceChildren("Features:", ...SAID.flatMap((name, kind) => [element("i", { className: "key", style: `background:${saidColour(kind)}` }), name]));
    // The container may be resized later. A resize of the canvas within the observer's callback would raise an error, so the redraw waits for an animation frame.
    const redraw = () => this.wanted && this.at(...this.wanted);
    new ResizeObserver(() => requestAnimationFrame(redraw)).observe(canvas.parentElement);
    canvas.addEventListener("click", (e) => this.chooseAt(e.offsetX / canvas.clientWidth, e.offsetY / canvas.clientHeight));
  }

  /// Draws the picture nearest to a frame.
  at(run, i, mover) {
    this.wanted = [run, i, mover];
    const picture = run.picture(i), canvas = this.canvas;
    canvas.hidden = picture < 0;
    if (picture < 0) {
      byId("caption-text").textContent = this.said = "The result holds no pictures of frames.";
      return;
    }
    const image = run.image(picture, () => this.wanted[0] === run && (this.wanted[1] === i || page.following) && this.draw(run, picture, mover));
    if (image.complete) this.draw(run, picture, mover);
    const shown = run.pictureFrame[picture];
    // In a live run, figures are some frames ahead of the picture.
    const note = Math.abs(run.pictureAt[picture] - i) <= (run.isLive ? 5 : 0) ? "" : ` (the nearest picture is of frame ${shown})`;
    const known = run.state[i] === LOST ? "" : `, ${run.inliers[i]} inliers, quality ${fixed(run.quality[i], 2)}, \u00b1${fixed(run.sigma_mm[i], 1)} mm`;
    const text = `Frame ${run.id[i]}, ${fixed(run.seconds[i], 2)} s: ${STATES[run.state[i]]}${known}${note}`;
    if (this.said !== text) byId("caption-text").textContent = text;
    this.said = text;
    canvas.setAttribute("aria-label", text);
  }

  /// Fits the canvas into its container at screen resolution, and draws it.
  draw(run, picture, mover) {
    const [w, h] = run.data.pictures.size, place = this.canvas.parentElement;
    const high = ONE_SCREEN.matches ? place.clientHeight : Infinity, scale = Math.min(place.clientWidth / w, high / h);
    const [width, height] = [`${Math.floor(scale * w)}px`, `${Math.floor(scale * h)}px`];
    if (this.canvas.style.width !== width || this.canvas.style.height !== height) [this.canvas.style.width, this.canvas.style.height] = [width, height];
    paintPicture(this.canvas, run, picture, { verdicts: byId("verdicts").checked, boxes: byId("boxes").checked, mover, scale: scale * density() });
  }

  /// Selects the smallest box at x, y (from 0 to 1), or none.
  chooseAt(x, y) {
    const [run, i] = this.wanted || [];
    if (!run || run.picture(i) < 0) return;
    const [w, h] = run.data.image, area = (b) => (b[2] - b[0]) * (b[3] - b[1]);
    const here = (run.objectsOf.get(run.pictureFrame[run.picture(i)]) || []).filter((o) => isDrawn(o, page.mover))
      .filter(({ bounds: b }) => b[0] <= x * w && x * w <= b[2] && b[1] <= y * h && y * h <= b[3]).sort((a, b) => area(a.bounds) - area(b.bounds));
    choose(here.length && here[0].id !== page.mover ? here[0].id : null);
  }

  /// Saves the drawn picture with its caption as PNG.
  save() {
    const from = this.canvas, bar = Math.round(from.width / 22), made = element("canvas", { width: from.width, height: from.height + bar });
    const g = made.getContext("2d");
    g.drawImage(from, 0, 0);
    g.fillStyle = css("--paper");
    g.fillRect(0, from.height, made.width, bar);
    g.fillStyle = css("--ink");
    g.font = `${Math.round(0.5 * bar)}px Roboto, sans-serif`;
    g.textBaseline = "middle";
    g.fillText(`Stillpoint \u00b7 ${page.run.label} \u00b7 ${this.said}`, 0.4 * bar, from.height + bar / 2, made.width - 0.8 * bar);
    element("a", { href: made.toDataURL("image/png"), download: `${page.run.name}-${page.run.id[page.frame]}.png` }).click();
  }
}

/// Moving objects, people and the selection have boxes.
const isDrawn = (o, mover) => o.motion === 1 || o.name === "person" || o.id === mover;

function paintPicture(canvas, run, picture, { verdicts, boxes, mover, scale }) {
  const [w, h] = run.data.pictures.size;
  [canvas.width, canvas.height] = [Math.round(w * scale), Math.round(h * scale)];
  // Scales symbols and labels.
  const unit = Math.max(0.5, canvas.width / 520);
  // Drawing hundreds of small discs is faster on the CPU than on an emulated GPU.
  const g = canvas.getContext("2d", { willReadFrequently: true }), image = run.image(picture);
  if (image.complete && image.naturalWidth) g.drawImage(image, 0, 0, canvas.width, canvas.height);
  if (verdicts) {
    const f = run.features(picture);
    // One path per kind: separate strokes would take most of the frame time.
    SAID.forEach((_, kind) => {
      const colour = saidColour(kind);
      const [dots, rings] = [new Path2D(), new Path2D()];
      const disc = (path, x, y, r) => { path.moveTo(x + r, y); path.arc(x, y, r, 0, 7); };
      for (let i = 0; i + 2 < f.length; i += 3) {
        if (f[i + 2] !== kind) continue;
        const [x, y] = [f[i] / 255 * canvas.width, f[i + 1] / 255 * canvas.height];
        disc(dots, x, y, unit * (kind ? 1.1 : 1.8));
        if (kind) disc(rings, x, y, unit * 3.2);
      }
      [g.fillStyle, g.strokeStyle, g.lineWidth] = [colour, colour, 1.2 * unit];
      g.fill(dots);
      if (kind) g.stroke(rings);
    });
  }
  if (!boxes) return;
  const factor = canvas.width / run.data.image[0];
  for (const o of run.objectsOf.get(run.pictureFrame[picture]) || []) {
    if (!isDrawn(o, mover)) continue;
    const [x0, y0, x1, y1] = Array.from(o.bounds, (v) => v * factor);
    if (x1 - x0 < 1 || y1 - y0 < 1) continue;
    const colour = css(`--object-${o.id % 8}`);
    g.strokeStyle = colour;
    g.lineWidth = unit * (o.id === mover ? 4 : 1.8);
    g.strokeRect(x0, y0, x1 - x0, y1 - y0);
    const label = `${o.name} ${o.id}` + (Number.isFinite(o.speed) && o.motion === 1 ? ` ${o.speed.toFixed(1)} m/s` : "");
    g.font = `${12 * unit}px Roboto, sans-serif`;
    const width = g.measureText(label).width + 8 * unit, high = 16 * unit, top = Math.max(0, y0 - high), left = Math.max(0, Math.min(x0, canvas.width - width));
    g.fillStyle = "#14171b";
    g.fillRect(left, top, width, high);
    g.fillStyle = colour;
    g.fillRect(left, top, 3 * unit, high);
    g.fillStyle = "#ffffff";
    g.textBaseline = "middle";
    g.fillText(label, left + 5 * unit, top + 0.53 * high);
  }
}
