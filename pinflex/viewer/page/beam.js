/* beam.js: one link: its stress along x, its section forces, and how one of them goes over time at a place. */
const SECTION = [["N", "N"], ["T", "N m"], ["Vy", "N"], ["Mz", "N m"], ["Vz", "N"], ["My", "N m"]];
const MEANING = {N: "normal force", T: "torsion", Vy: "shear force along y", Vz: "shear force along z", My: "bending moment about y", Mz: "bending moment about z"};
let beam = null;                                   // what the panel shows: link, diagrams, picked station, quantity

const linkOf = (run, name) => run && run.links.find((k) => k.name === name);
/* Quantities along a link: {key, title, unit, factor, a (nt, m)}, with their least and largest at every station. */
function quantities(k) {
  const m = k.x.length, out = [];
  for (const f of R.fields) if (k.fields[f.key] && f.key === "von_mises") out.push({key: f.key, title: "von Mises", unit: f.unit, factor: f.factor, a: k.fields[f.key]});
  for (const [key, unit] of SECTION) if (k.sections[key]) out.push({key, title: key, unit, factor: 1, a: k.sections[key]});
  return out.map((q) => ({...q, m, ...envelope(q, m)}));
}
function envelope({a, factor}, m) {
  const low = new Float32Array(m).fill(Infinity), high = new Float32Array(m).fill(-Infinity), rows = a.length / m;
  for (let r = 0; r < rows; r++) for (let i = 0; i < m; i++) {
    const v = factor * a[r * m + i];
    if (v < low[i]) low[i] = v;
    if (v > high[i]) high[i] = v;
  }
  return {low, high};
}
function along(q, at, out) {                       // values at every station at an instant, in the unit shown
  lerp(q.a, q.m, at, out);
  for (let i = 0; i < q.m; i++) out[i] *= q.factor;
  return out;
}
const overTime = (q, i) => Float32Array.from({length: q.a.length / q.m}, (_, r) => q.factor * q.a[r * q.m + i]);
function worstStation(q) {
  let best = 0;
  for (let i = 0; i < q.m; i++) if (Math.max(Math.abs(q.low[i]), Math.abs(q.high[i])) > Math.max(Math.abs(q.low[best]), Math.abs(q.high[best]))) best = i;
  return best;
}

function openBeam() {
  const k = S.link !== null && !R.mode && linkOf(R, S.link), panel = $("beam"), was = panel.hidden;
  const list = k ? quantities(k) : [];              // none in a rigid run
  panel.hidden = !list.length;
  document.body.classList.toggle("beamed", !!list.length);
  beam = null;
  if (!list.length) { panel.replaceChildren(); if (!was) layoutChanged(); return; }
  const b = scene.links.find((x) => x.data === k);
  if (was) layoutChanged();
  const asked = S.at === null ? -1 : b.share.reduce((best, x, i) => Math.abs(x - S.at) < Math.abs(b.share[best] - S.at) ? i : best, 0);
  const chosen = list.find((q) => q.key === (beam_quantity || "von_mises")) || list[0], station = asked >= 0 || !chosen ? Math.max(asked, 0) : worstStation(chosen);
  beam = {k, list, chosen, station, x: Array.from(k.x, (x) => 1e3 * x), now: new Float32Array(k.x.length)};
  panel.setAttribute("aria-label", `link ${k.name}`);
  panel.replaceChildren(beamHead(k, list), el("div", {id: "diagrams"}), el("div", {id: "history"}));
  drawDiagrams();
  drawHistory();
  moveBeam(instant(S.t));
}
let beam_quantity = null;
function beamHead(k, list) {
  const q = list[0], i = q && worstStation(q), top = q ? Math.max(Math.abs(q.low[i]), Math.abs(q.high[i])) : 0;
  const share = q && k.strength > 0 ? `, ${digits(100 * top / k.strength, 2)} % of yield` : "";
  return el("header", {}, el("h2", {}, k.name), el("div", {class: "tools"},
    button("CSV", saveBeam, {title: "this link: along x now, and over time at the place chosen"}), button("✕", closeBeam, {"aria-label": "close link", id: "beam-close"})),
    el("p", {}, `${digits(1e3 * k.length)} mm` + (q ? ` · ${digits(top)} ${q.unit} at ${digits(1e3 * k.x[i])} mm${share}` : "")));
}
function closeBeam() { set({link: null, at: null}); $("pane").focus({preventScroll: true}); }
function drawDiagrams() {
  const host = $("diagrams"), x = [beam.x[0], beam.x[beam.x.length - 1]], other = linkOf(otherRun(), beam.k.name), twins = other && other.x.length === beam.x.length ? quantities(other) : [];
  for (const q of beam.list) {
    const pick = (v) => { beam_quantity = q.key; set({at: +((v - x[0]) / (x[1] - x[0])).toPrecision(4)}); };
    q.twin = twins.find((t) => t.key === q.key);
    q.chart = new Chart(host, {title: q.title, unit: q.unit, x, y: rangeOf(q.low, q.high), xUnit: "mm", pick, label: `${MEANING[q.key] || q.title + " stress"} along ${beam.k.name}, in ${q.unit}`});
    q.chart.figure.title = MEANING[q.key] || "von Mises stress; shaded: all of the run";
    q.chart.figure.classList.toggle("chosen", q === beam.chosen);
    q.chart.figure.classList.toggle("wide", q.key === "von_mises");
  }
  for (const q of beam.list) q.chart.measure();
  for (const q of beam.list) {
    q.chart.draw();
    const back = beam.x.map((v, i) => [v, q.low[i]]).reverse();
    q.chart.add("band", 0).setAttribute("d", q.chart.way([...beam.x, ...back.map((p) => p[0])], [...q.high, ...back.map((p) => p[1])]) + "Z");
    q.other = q.twin && q.chart.add("curve rigid", 0);
    q.line = q.chart.add("curve", 0);
  }
}
function drawHistory() {
  const host = $("history"), q = beam.chosen, T = R.t;
  if (!q) return;
  const y = overTime(q, beam.station), twin = q.twin && resampled(overTime(q.twin, beam.station), otherRun().t, 1);
  const ways = (twin ? [twin, y] : [y]).map((values) => windowed(T, values));
  const title = `${q.title} at x = ${digits(beam.x[beam.station])} mm`;
  const names = twin ? el("span", {class: "names"}, el("span", {class: "dash"}, `┄ ${otherName()}`)) : null;
  beam.time = new Chart(host, {title, unit: q.unit, x: span(), y: rangeOf(...ways.map((way) => way[1])), close: !!S.zoom, xUnit: "s", names, pick: (t) => seek(t), zoom: zoomOf,
    label: `${title} over time, in ${q.unit}`}).measure().draw();
  ways.forEach((way, i) => beam.time.add(i < ways.length - 1 ? "curve rigid" : "curve", 0).setAttribute("d", beam.time.way(...way)));
  beam.y = y;
}
function moveBeam(at) {
  if (!beam) return;
  const other = otherRun(), then = other && instant(S.t, other.t);
  for (const q of beam.list) {
    along(q, at, beam.now);
    q.line.setAttribute("d", q.chart.way(beam.x, beam.now));
    q.chart.values.textContent = minus(digits(beam.now[beam.station]));
    q.chart.at(beam.x[beam.station]);
    if (q.other) q.other.setAttribute("d", q.chart.way(beam.x, along(q.twin, then, beam.now)));
  }
  if (!beam.time) return;
  beam.time.at(S.t);
  beam.time.values.textContent = minus(digits(mixed(beam.y, at)));
}
