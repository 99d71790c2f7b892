/* plots.js: curves over time under the controls, with those of what the run is compared with. */
let plots = [];
const UNITS = {"µm": 1e-3, mm: 1, "N m": 1, N: 1, MPa: 1};

/* Plots to show: {title, unit, curves: [{name, y, colour, rigid}]}; rigid: of the other run, dashed. */
function plotList() {
  const other = otherRun(), list = R.plots.map((p) => {
    if (p.race) return p;                          // it has the curves of all runs
    const own = p.curves.filter((c) => !c.rigid), twin = other && other.plots.find((q) => q.title === p.title);
    if (!other) return S.diff ? less(p, own, p.curves.filter((c) => c.rigid)) : p;
    const pale = twin ? twin.curves.filter((c) => !c.rigid).map((c) => ({...c, rigid: true, y: resampled(c.y, other.t, UNITS[twin.unit] / UNITS[p.unit])})) : [];
    if (S.diff && p.deviation) return apart(p, other);
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
  const host = $("plots"), list = R && S.plots ? plotList() : [], {scrollLeft: left, scrollTop: top} = host;
  const names = () => [...host.querySelectorAll(".name")], focus = names().indexOf(document.activeElement);
  document.body.classList.toggle("plots", list.length > 0);
  host.replaceChildren();
  const column = getComputedStyle(host).flexDirection === "column", one = innerWidth < 620 || column;
  const width = one ? host.clientWidth : host.clientWidth / Math.max(list.length, 1), x = list.length ? span() : null;
  plots = list.map((p) => {
    const {values, shown, line} = caption(p, width);
    const chart = new Chart(host, {title: p.title, unit: p.unit, x, y: [0, 0], close: !!S.zoom, xUnit: "s", names: line,
      pick: (t) => seek(t), zoom: zoomOf, label: `${p.title} over time, in ${p.unit}`});
    chart.values.append(...shown);
    return {p, values, chart};
  });
  for (const {chart} of plots) chart.measure();    // all in place before any is measured, and all measured before any is drawn:
  plots.forEach(drawPlot);                         // the browser lays the page out once
  host.scrollTo(left, top);
  names()[focus]?.focus({preventScroll: true});    // just clicked, it goes on being the one
  movePlots(instant(S.t));
}
function drawPlot(plot) {
  const {p, chart} = plot, drawn = p.curves.filter(isShown).map((c) => ({...c, way: windowed(R.t, c.y)}));
  Object.assign(chart.spec, {x: span(), y: rangeOf(...drawn.map((c) => c.way[1]))});
  chart.draw();
  for (const m of R.marks || []) chart.mark(m);
  for (const c of drawn.sort((c, d) => d.rigid - c.rigid)) chart.add(c.rigid ? "curve rigid" : "curve", c.colour).setAttribute("d", chart.way(...c.way));
  plot.of = [R.t, ...p.curves.map((c) => c.y)];
}
/* Draw one of the plots whose curves have other values than it shows; true: none is left. */
function drawChanged() {
  const list = R && S.plots ? plotList() : [], curves = (p) => [R.t, ...p.curves.map((c) => c.y)];
  if (list.length !== plots.length || list.some((p, i) => p.title !== plots[i].p.title || p.curves.length + 1 !== plots[i].of.length)) { drawPlots(); return true; }
  const [i, ...others] = [...list.keys()].filter((k) => curves(list[k]).some((y, n) => y !== plots[k].of[n]));
  if (i === undefined) return true;
  plots[i].p = list[i];
  drawPlot(plots[i]);
  movePlots(instant(S.t));
  return !others.length;
}
function movePlots(at) {
  for (const {p, chart, values} of plots) {
    chart.at(S.t);
    const some = p.curves.filter((c) => !c.rigid);
    if (values) values.forEach((v, i) => { v.textContent = isShown(some[i]) ? minus(digits(mixed(some[i].y, at))) : ""; });
  }
}
