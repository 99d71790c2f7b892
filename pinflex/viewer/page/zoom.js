/* zoom.js: a part of the time, the same in all plots: by a drag, the wheel, two fingers on a touch pad, or a key. */
const whole = () => [R.t[0], R.t[R.t.length - 1]];
const span = () => S.zoom ? S.zoom.map((t) => clamp(t, ...whole())) : whole();   // of runs some end early
const GRIP = 7, MOVED = 5;                         // [px] about the cursor, to take hold of it; of a drag that is no click

function zoomTo(a, b) {
  if (!R.plots.length) return;
  const [first, last] = whole(), least = 2 * (last - first) / R.t.length, from = clamp(Math.min(a, b), first, last), to = clamp(Math.max(a, b), first, last);
  if (to - from >= 0.999 * (last - first)) set({zoom: null});
  else if (to - from > least) set({zoom: [from, to].map((t) => +t.toPrecision(6))});
}
/* About an instant, which keeps its place. */
function zoomBy(factor, t = S.t) {
  const [a, b] = span(), about = clamp(t, a, b);
  zoomTo(about - factor * (about - a), about + factor * (b - about));
}

/* A curve within the part shown, with values at its ends; it stops where its run ended. */
function windowed(T, y) {
  const [a, b] = span(), ends = [a, b].map((t) => mixed(y, instant(t, T))), xs = [a], ys = [ends[0]];
  for (let i = 0; i < T.length; i++) if (T[i] > a && T[i] < b) { xs.push(T[i]); ys.push(y[i]); }
  const n = [...ys, ends[1]].findIndex((v) => !isFinite(v));
  return n < 0 ? [[...xs, b], [...ys, ends[1]]] : [xs.slice(0, n), ys.slice(0, n)];
}

/* A click moves the cursor, and so does a drag of it; any other drag marks what to zoom to. */
function zoomable(chart) {
  const {svg, spec} = chart, mark = el("rect", {class: "marked", y: 3, height: chart.h - LOW - 3, width: 0});
  let from = null, held = false;
  svg.append(mark);
  svg.addEventListener("pointerdown", (e) => {
    const t = chart.under(e);
    held = Math.abs(chart.X(t) - chart.X(S.t)) < GRIP;
    from = t;
    if (e.pointerType !== "touch") svg.setPointerCapture(e.pointerId);   // a finger may scroll the plots
  });
  svg.addEventListener("pointermove", (e) => {
    if (from === null) return;
    const t = chart.under(e), [p, q] = [chart.X(from), chart.X(t)];
    if (held) { spec.pick(t); return; }
    mark.setAttribute("x", Math.min(p, q)); mark.setAttribute("width", Math.abs(q - p) > MOVED ? Math.abs(q - p) : 0);
  });
  svg.addEventListener("pointerup", (e) => {
    const start = from, t = chart.under(e);
    from = null;
    if (start === null) return;
    if (!held && +mark.getAttribute("width")) spec.zoom([start, t]); else spec.pick(t);
  });
  svg.addEventListener("pointercancel", () => { from = null; mark.setAttribute("width", 0); });
  svg.addEventListener("dblclick", () => spec.zoom(null));
  svg.addEventListener("wheel", (e) => {
    const host = $("plots"), scrolls = host.scrollWidth > host.clientWidth + 1 || host.scrollHeight > host.clientHeight + 1;
    if (scrolls && !e.ctrlKey) return;             // two fingers that move apart come as a wheel with ctrl
    e.preventDefault();
    zoomBy(e.deltaY < 0 ? 0.8 : 1.25, chart.under(e));
  }, {passive: false});
}
const zoomOf = (ends) => ends ? zoomTo(...ends) : set({zoom: null});
