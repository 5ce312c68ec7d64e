"use strict";
// Worst and notable frames.

/// Shows frames with the largest error, else 1 sigma, spaced apart in time.
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
    const canvas = element("canvas", { style: "width:160px" }), text = run.state[i] === LOST ? "no pose" : `${fixed(values[i], 1)} ${by[2]}`;
    const picture = run.picture(i);
    if (picture >= 0) {
      const paint = () => paintPicture(canvas, run, picture, { verdicts: true, boxes: false, mover: null, scale: 160 / run.data.pictures.size[0] * density() });
      const image = run.image(picture, paint);
      if (image.complete) paint();
    } else canvas.hidden = true;
    return element("li", {}, element("button", { type: "button", onclick: () => { seek(i); byId("screen").scrollIntoView(); } }, canvas, `frame ${run.id[i]}: ${text}`));
  }));
}

/// Notable frames, the most important first, as (name, index, value).
function notable(run) {
  const list = [], most = (values, keep) => {
    let best = -1;
    for (let i = 0; i < run.count; i++) if (Number.isFinite(values[i]) && keep(i) && !(values[i] <= values[best])) best = i;
    return best;
  };
  const losses = (run.summary.lost || []).slice().sort((a, b) => b.seconds - a.seconds);
  if (losses.length) list.push([losses.length > 1 ? "Longest loss" : "Loss", run.at(losses[0].first), `${fixed(losses[0].seconds, 1)} s`]);
  // While it is undecided what moves, the quality of poses is unknown.
  const decided = (i) => run.state[i] < UNDECIDED && run.state[i] !== LOST;
  const hasTruth = run.error_mm.some(Number.isFinite), name = hasTruth ? "error_mm" : "sigma_mm";
  const sure = most(run[name], decided), worst = sure >= 0 ? sure : most(run[name], () => true);
  if (worst >= 0) list.push([hasTruth ? "Largest error" : "Least certain", worst, `${fixed(run[name][worst], 1)} mm`]);
  const moving = most(run.moving, () => true);
  if (moving >= 0 && run.moving[moving] > 0.02) list.push(["Most movement", moving, `${fixed(100 * run.moving[moving], 0)} %`]);
  const loop = run.marks.find((m) => m.kind === "loop");
  if (loop) list.push(["Loop closed", loop.at, ""]);
  return list;
}

function showNotable(run) {
  page.notable = notable(run);
  byId("jumps").replaceChildren(...page.notable.map(([name, i, value]) => element("li", {}, element("button", { type: "button", title: value, onclick: () => seek(i) }, `${name}${value ? ` ${value}` : ""}: frame ${run.id[i]}`))));
}
