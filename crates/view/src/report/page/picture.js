"use strict";
// The frame: its picture, and what was said of it.

/// As in the pictures of `--overlay`: what stands still is a disc, what was rejected a ring with a dot.
const SAID = [["stands still", "#1ec86e"], ["on a moving object", "#ee341c"], ["moves against the scene", "#ff9600"], ["off its epipolar line", "#ffe828"], ["depth of what moves", "#ffd6a8"], ["moved before", "#a85c24"]];

class FramePicture {
  constructor(canvas) {
    this.canvas = canvas;
    // What is written anew with every frame is drawn anew: the legend stands beside it.
    const swatch = ([name, colour]) => [element("i", { style: `display:inline-block;width:.7em;height:.7em;border-radius:50%;margin:0 .3em 0 .8em;background:${colour}` }), name];
    byId("said").replaceChildren("Features:", ...SAID.flatMap(swatch));
  }

  /// Draws the picture that is nearest to a frame.
  at(run, i, mover) {
    this.wanted = [run, i, mover];
    const picture = run.picture(i), canvas = this.canvas;
    canvas.hidden = byId("said").hidden = picture < 0;
    if (picture < 0) {
      byId("caption-text").textContent = this.said = "The result holds no pictures of frames.";
      return;
    }
    const image = run.image(picture, () => this.wanted[0] === run && (this.wanted[1] === i || page.following) && this.draw(run, picture, mover));
    if (image.complete) this.draw(run, picture, mover);
    const shown = run.pictureFrame[picture];
    // While a run goes on, numbers are some frames ahead of the picture.
    const note = Math.abs(run.pictureAt[picture] - i) <= (run.isLive ? 5 : 0) ? "" : ` (the nearest picture is of frame ${shown})`;
    const text = `Frame ${run.id[i]}, ${fixed(run.seconds[i], 2)} s: ${STATES[run.state[i]]}${note}`;
    if (this.said !== text) byId("caption-text").textContent = text;
    this.said = text;
    canvas.setAttribute("aria-label", text);
  }

  draw(run, picture, mover) {
    paintPicture(this.canvas, run, picture, { verdicts: byId("verdicts").checked, boxes: byId("boxes").checked, mover, scale: 3 });
  }
}

function paintPicture(canvas, run, picture, { verdicts, boxes, mover, scale }) {
  const [w, h] = run.data.pictures.size;
  [canvas.width, canvas.height] = [w * scale, h * scale];
  // Some hundred small discs are drawn faster by the processor than by what stands for a graphics card where there is none.
  const g = canvas.getContext("2d", { willReadFrequently: true }), image = run.image(picture);
  if (image.complete && image.naturalWidth) g.drawImage(image, 0, 0, canvas.width, canvas.height);
  if (verdicts) {
    const f = run.features(picture);
    // One path for all of a kind: a stroke for each would take most of the time of a frame.
    SAID.forEach(([, colour], kind) => {
      const [dots, rings] = [new Path2D(), new Path2D()];
      const disc = (path, x, y, r) => { path.moveTo(x + r, y); path.arc(x, y, r, 0, 7); };
      for (let i = 0; i + 2 < f.length; i += 3) {
        if (f[i + 2] !== kind) continue;
        const [x, y] = [f[i] / 255 * canvas.width, f[i + 1] / 255 * canvas.height];
        disc(dots, x, y, kind ? 1.2 : 2);
        if (kind) disc(rings, x, y, 3.5);
      }
      [g.fillStyle, g.strokeStyle, g.lineWidth] = [colour, colour, 1.4];
      g.fill(dots);
      if (kind) g.stroke(rings);
    });
  }
  if (!boxes) return;
  const factor = canvas.width / run.data.image[0];
  for (const o of run.objectsOf.get(run.pictureFrame[picture]) || []) {
    if (o.motion !== 1 && o.name !== "person" && o.id !== mover) continue;
    const [x0, y0, x1, y1] = Array.from(o.bounds, (v) => v * factor);
    if (x1 - x0 < 1 || y1 - y0 < 1) continue;
    const colour = TRACKS.dark[o.id % 5];
    g.strokeStyle = colour;
    g.lineWidth = o.id === mover ? 5 : 2;
    g.strokeRect(x0, y0, x1 - x0, y1 - y0);
    const label = `${o.name} ${o.id}` + (Number.isFinite(o.speed) && o.motion === 1 ? ` ${o.speed.toFixed(1)} m/s` : "");
    g.font = "600 14px system-ui, sans-serif";
    const width = g.measureText(label).width + 8, top = Math.max(0, y0 - 18);
    g.fillStyle = "#14171b";
    g.fillRect(x0, top, width, 18);
    g.fillStyle = colour;
    g.textBaseline = "middle";
    g.fillText(label, x0 + 4, top + 9.5);
  }
}
