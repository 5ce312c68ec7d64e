"use strict";
// Where it went wrong most.

/// The frames that are farthest off, or least certain; not one beside the other.
function worst(run) {
  const by = run.error_mm.some(Number.isFinite) ? ["error_mm", "distance to the truth", "mm"] : ["sigma_mm", "standard deviation of the position", "mm"];
  const values = run[by[0]], found = [];
  const candidates = Array.from(run.pictureAt.length ? new Set(run.pictureAt) : run.id.keys()).filter((i) => Number.isFinite(values[i]) || run.state[i] === LOST);
  const bad = (i) => (run.state[i] === LOST ? Infinity : values[i]);
  candidates.sort((a, b) => bad(b) - bad(a) || a - b);
  for (const i of candidates) {
    if (found.length < 6 && found.every((f) => Math.abs(f - i) > Math.max(5, run.count / 60))) found.push(i);
  }
  byId("worst-by").textContent = found.length ? `By ${by[1]}; frames without a pose first.` : "Nothing is known of how good the poses are.";
  byId("worst").replaceChildren(...found.map((i) => {
    const canvas = element("canvas", {}), text = run.state[i] === LOST ? "no pose" : `${fixed(values[i], 1)} ${by[2]}`;
    const picture = run.picture(i);
    if (picture >= 0) {
      const paint = () => paintPicture(canvas, run, picture, { verdicts: true, boxes: true, mover: null, scale: 2 });
      const image = run.image(picture, paint);
      if (image.complete) paint();
    } else canvas.hidden = true;
    return element("li", {}, element("button", { type: "button", onclick: () => { seek(i); byId("scene").scrollIntoView({ block: "nearest" }); } }, canvas, `frame ${run.id[i]}: ${text}`));
  }));
}
