/* plots.js: curves over time under the controls, with those of what the run is compared with. */
let plots = [];
const UNITS = {"µm": 1e-3, mm: 1, "N m": 1, N: 1, MPa: 1};

/* Plots to show: {title, unit, curves: [{name, y, colour, rigid}]}; rigid: of the other run, dashed. */
function plotList() {
  const other = otherRun(), list = R.plots.map((p) => {
    const own = p.curves.filter((c) => !c.rigid), twin = other && other.plots.find((q) => q.title === p.title);
    if (!other) return S.diff ? less(p, own, p.curves.filter((c) => c.rigid)) : p;
    const pale = twin ? twin.curves.filter((c) => !c.rigid).map((c) => ({...c, rigid: true, y: resampled(c.y, other.t, UNITS[twin.unit] / UNITS[p.unit])})) : [];
    if (S.diff && p.title.endsWith("off rigid")) return apart(p, other);
    return S.diff ? less(p, own, pale) : {...p, curves: own.concat(pale)};
  });
  if (S.force && scene.forces.length) list.push(forcePlot());
  return list;
}
function less(p, own, others) {                    // each curve less its twin
  const curves = own.map((c) => { const twin = others.find((o) => o.name === c.name); return twin && {...c, y: c.y.map((y, i) => y - twin.y[i])}; }).filter(Boolean);
  return curves.length ? {...p, title: `Δ ${p.title}`, curves} : p;
}
function apart(p, other) {                         // distance of the platform from itself in the other run
  if (!other.track || other.track.disp.length !== R.track.disp.length) return p;
  const d = R.track.disp, e = other.track.disp, y = Float32Array.from(R.t, (_, i) => R.track.factor * Math.hypot(d[3 * i] - e[3 * i], d[3 * i + 1] - e[3 * i + 1], d[3 * i + 2] - e[3 * i + 2]));
  return {...p, title: `${R.track.name} off ${otherName()}`, apart: true, curves: [{...p.curves[0], y}]};
}
function resampled(y, T, factor) {
  const alike = T.length === R.t.length && T.every((t, i) => t === R.t[i]), end = T[T.length - 1];
  return alike && factor === 1 ? y : Float32Array.from(R.t, (t) => t > end + 1e-9 ? NaN : factor * mixed(y, instant(t, T)));
}
function forcePlot() {
  const n = R.t.length, curves = R.forces.map((f) => ({name: f.name, rigid: false, y: Float32Array.from(R.t, (_, i) => Math.hypot(f.vector[3 * i], f.vector[3 * i + 1], f.vector[3 * i + 2]))}));
  const most = curves.sort((a, b) => maxAbs(b.y) - maxAbs(a.y)).slice(0, SERIES).map((c, i) => ({...c, colour: i}));
  return {title: most.length < R.forces.length ? `largest joint forces` : "joint force", unit: "N", curves: most};
}

function drawPlots() {
  const host = $("plots"), list = R && S.plots ? plotList() : [], first = host.scrollLeft;
  document.body.classList.toggle("plots", list.length > 0);
  host.replaceChildren();
  const column = getComputedStyle(host).flexDirection === "column", one = innerWidth < 620 || column;
  const width = one ? host.clientWidth : host.clientWidth / Math.max(list.length, 1), T = R.t, x = [T[0], T[T.length - 1]];
  plots = list.map((p) => {
    const {names, line} = named(p, width);
    return {p, names, chart: new Chart(host, {title: p.title, unit: p.unit, x, y: rangeOf(...p.curves.map((c) => c.y)), xUnit: "s", names: line, pick: (t) => seek(t), label: `${p.title} over time, in ${p.unit}`})};
  });
  for (const {p, chart} of plots) {                // all in place before any is measured
    chart.draw();
    for (const c of p.curves.slice().sort((c, d) => d.rigid - c.rigid)) chart.add(c.rigid ? "curve rigid" : "curve", c.colour).setAttribute("d", chart.way(...finite(T, c.y)));
  }
  host.scrollLeft = first;
  movePlots(instant(S.t));
}
const finite = (x, y) => { const n = y.findIndex((v) => !isFinite(v)); return n < 0 ? [x, y] : [x.slice(0, n), y.slice(0, n)]; };

/* Names of a plot's curves: before their values where there is room, without what all have in common
   where there is less, in a line of their own where there is little, without values where those do not fit either. */
function named(p, width) {
  const some = p.curves.filter((c) => !c.rigid).slice(0, SERIES), full = some.map((c) => c.name), pale = p.curves.some((c) => c.rigid);
  const line = (...parts) => parts.length ? el("span", {class: "names"}, ...parts) : null, dash = pale ? [el("span", {class: "dash"}, `┄ ${otherName()}`)] : [];
  const longest = (y) => { let n = 0; for (let i = 0; i < y.length; i += 1 + (y.length >> 6)) n = Math.max(n, digits(y[i]).length); return n; };
  const widths = some.reduce((n, c) => n + longest(c.y) + 2.5, 0);   // of the whole run: nothing jumps as it plays
  if (some.length < 2) return {names: [""], line: line(...dash)};
  const room = width / 6.6 - p.title.length - p.unit.length - 6, fits = (names) => names.join("").length + widths < room, short = shortened(full);
  for (const names of [full, short]) if (fits(names)) return {names, line: line(...dash)};
  return {names: 0.9 * widths < room ? some.map(() => "") : null, line: line(...dash, ...some.map((c, i) => el("span", {style: `color: ${series(c.colour)}`}, short[i])))};
}
function shortened(full) {
  const common = (names) => { let n = 0; while (names.every((s) => n < s.length && s[n] === names[0][n])) n++; return n; };
  const start = full[0].slice(0, common(full)).match(/^.*[_\W]/) || [""], back = (s) => [...s].reverse().join("");
  const tail = full[0].slice(full[0].length - common(full.map(back))).match(/[_\W].*$/) || [""];
  const brief = full.map((s) => s.slice(start[0].length, s.length - tail[0].length));
  return brief.every((s) => /[a-z]/i.test(s)) ? brief : full;
}
function movePlots(at) {
  for (const {p, chart, names} of plots) {
    chart.at(S.t);
    if (!names) continue;
    const some = p.curves.filter((c) => !c.rigid).slice(0, SERIES);
    chart.values.replaceChildren(...some.map((c, i) => el("span", {style: `color: ${series(c.colour)}`, title: c.name},
      (names[i] ? names[i] + " " : "") + minus(digits(mixed(c.y, at))))));
  }
}
