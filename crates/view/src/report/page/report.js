"use strict";
// The page of finished runs, with all their data.

function start() {
  page.runs = JSON.parse(byId("data").textContent).map((d) => new Run(d));
  page.runs.forEach((r, i) => { r.label = page.runs.filter((o) => o.name === r.name).length > 1 ? `${r.name} (${i + 1})` : r.name; });
  prepare();
  showComparison(page.runs);
  const nav = byId("runs");
  nav.hidden = page.runs.length < 2;
  nav.replaceChildren(...page.runs.map((r) => element("button", { type: "button", onclick: () => select(r) }, r.label)));
  select(page.runs[Number(new URLSearchParams(location.hash.slice(1)).get("run")) || 0]);
  // Opens at the most notable frame.
  if (page.notable.length) seek(page.notable[0][1]);
  openAt(location.hash);
  page.ready = true;
}

start();
