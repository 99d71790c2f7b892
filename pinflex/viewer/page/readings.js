/* readings.js: colours and their legend, texts, marks, hover, plots. */
/* ---------------------------------------------------------------- colours and legend */
const fieldOf = (key) => R.fields.find((f) => f.key === key);
function peakOf(key) {                             // largest magnitude of a field over the run, where and when
  if (scene.peaks[key]) return scene.peaks[key];
  const best = {value: 0, link: null, frame: 0, station: 0, signed: false};
  let low = 0, high = 0;
  scene.links.forEach((b) => {
    const f = b.fields[key];
    if (f) for (let i = 0; i < f.length; i++) {
      const v = f[i];
      if (v < low) low = v; else if (v > high) high = v;
      if (Math.abs(v) > Math.abs(best.value)) Object.assign(best, {value: v, link: b, frame: Math.floor(i / f.shape[1])});
    }
  });
  best.signed = low < -1e-3 * Math.max(high, -low);
  return (scene.peaks[key] = best);
}
const fieldMax = () => Math.abs(peakOf(S.field).value) * scene.factor;
const legendMax = () => (S.max > 0 ? S.max : fieldMax()) || 1;
const fullMax = () => Math.max(legendMax(), fieldMax());   // what the texture spans: more than the legend, if need be

function colourAt(u) {                             // u in 0..1 to [r, g, b]
  const hex = MAPS[scene.signed ? "signed" : S.map], n = hex.length / 6 - 1, x = clamp(u, 0, 1) * n, i = Math.min(Math.floor(x), n - 1);
  const part = (j, c) => parseInt(hex.substr(6 * j + 2 * c, 2), 16);
  return [0, 1, 2].map((c) => Math.round(part(i, c) * (1 - x + i) + part(i + 1, c) * (x - i)));
}
const isStress = () => /stress/.test((fieldOf(S.field) || {}).label || "") && !R.mode;
function colourOf(v) {                             // v in the shown unit; beyond the legend the end colour stays
  if (S.limit > 0 && isStress() && Math.abs(v) > S.limit) return OVER;
  const top = legendMax(), low = scene.signed ? -top : 0;
  return colourAt((v - low) / (top - low));
}

function legendTicks() {                           // [value, text]: round numbers, and the end itself
  const top = legendMax(), low = scene.signed ? -top : 0, step = nice((top - low) / 4.5), apart = innerWidth < 700 ? 0.17 : 0.07, ends = scene.signed ? [low, top] : [top], out = ends.map((v) => [v, minus(digits(v))]);
  for (let i = Math.ceil(low / step); i * step <= top; i++)
    if (ends.every((v) => Math.abs(v - i * step) > apart * (top - low))) out.push([i * step, minus(+(i * step).toPrecision(6))]);
  return out;
}
function setColours() {
  const f = fieldOf(S.field) || R.fields[0];
  if (!f) { $("legend").hidden = !R.torques.length && !R.forces.length; $("legend-title").hidden = $("scale").hidden = true; return; }
  $("legend").hidden = $("legend-title").hidden = $("scale").hidden = false;
  S.field = f.key;
  scene.factor = R.mode ? 1 / (Math.abs(peakOf(f.key).value) || 1) : f.factor;
  scene.signed = peakOf(f.key).signed;
  const image = scene.lut.image.data, top = legendMax(), low = scene.signed ? -top : 0, full = fullMax();
  for (let i = 0; i < 1024; i++) image.set([...colourOf(full * (scene.signed ? (2 * i - 1023) / 1023 : i / 1023)), 255], 4 * i);
  scene.lut.needsUpdate = true;
  const stops = Array.from({length: 65}, (_, i) => `rgb(${colourOf(low + (top - low) * i / 64).join(",")}) ${(i / 0.64).toFixed(1)}%`);
  $("bar").style.setProperty("--up", `linear-gradient(to top, ${stops})`);
  $("bar").style.setProperty("--right", `linear-gradient(to right, ${stops})`);
  $("bar").classList.toggle("off", !S.colours);
  $("unit").textContent = R.mode ? "relative" : `[${f.unit}]`;
  const ticks = legendTicks().map(([v, text]) => el("span", {style: `--u:${(v - low) / (top - low)}`}, text));
  const limited = S.limit > 0 && isStress();
  if (limited && S.limit < top) ticks.push(el("b", {style: `--u:${(S.limit - low) / (top - low)}`}, ""));
  $("ticks").replaceChildren(...ticks);
  const keys = [];
  if (S.max > 0 && S.max < 0.999 * fieldMax()) keys.push([null, `run maximum ${digits(fieldMax())} ${f.unit}`]);
  if (limited) keys.push(["limit", `limit ${digits(S.limit)} ${f.unit}${fieldMax() > S.limit ? ", exceeded" : ""}`]);
  if (S.force && scene.forceMax) keys.push(["force", `joint force, longest ${digits(scene.forceMax)} N`]);
  if (S.torque && scene.torqueMax) keys.push(["torque", `motor torque, largest ${digits(scene.torqueMax)} N m`]);
  if (S.path && scene.path) keys.push(["path", `path of ${R.track.name}`]);
  if (S.ghost !== "off" && scene.moves) keys.push(["ghost", R.mode ? "at rest" : "rigid mechanism"]);
  $("keys").replaceChildren(...keys.map(([k, text]) => el("div", {class: k ? "key " + k : ""}, text)));
}

/* ---------------------------------------------------------------- texts that follow the time */
const clockDigits = () => clamp(Math.ceil(-Math.log10(Math.max(R.t[R.t.length - 1] - R.t[0], 1e-9))) + 3, 1, 6);
function clock(t) {
  const [a, b] = [R.t[0], R.t[R.t.length - 1]];
  return R.mode ? `phase ${Math.round(360 * (t - a) / (b - a))}°` : `${t.toFixed(clockDigits())} s`;
}
function refresh(k, w) {
  const end = R.t[R.t.length - 1], time = $("time");
  time.value = S.t;
  time.setAttribute("aria-valuetext", clock(S.t));
  $("clock").textContent = R.mode ? clock(S.t) : `${S.t.toFixed(clockDigits())} / ${end.toFixed(clockDigits())} s`;
  const parts = [];
  if (scene.moves) parts.push(el("span", {class: "mag"}, R.mode ? "shape, not to scale" : `deflection ×${+S.mag.toPrecision(3)}`));
  parts.push(el("span", {}, R.mode ? clock(S.t) : `t = ${clock(S.t)}`));
  if (R.track && !R.mode && maxAbs(R.track.deviation) > 0) {
    const d = R.track.deviation[k] * (1 - w) + (w > 0 ? R.track.deviation[k + 1] * w : 0);
    const a = R.track.angle[k] * (1 - w) + (w > 0 ? R.track.angle[k + 1] * w : 0);
    parts.push(el("span", {}, `${R.track.name}: ${digits(R.track.factor * d)} ${R.track.unit}${a > 0 ? `, ${digits(R.track.angle_factor * a)} ${R.track.angle_unit}` : ""} off rigid`));
  }
  $("readout").replaceChildren(...parts);
  scene.top = null;
  for (const b of scene.links) for (let i = 0; i < b.now.length; i++)
    if (!scene.top || Math.abs(b.now[i]) > Math.abs(scene.top.link.now[scene.top.i])) scene.top = {link: b, i};
  movePlots();
}
function announce() {                              // for a screen reader, when the motion rests
  if (S.play || !R) return;
  const f = fieldOf(S.field), top = scene.top;
  const text = `${DATA.title}, ${clock(S.t)}, magnification ${S.mag}` +
    (f && top ? `, ${f.label} at most ${digits(Math.abs(top.link.now[top.i]) * scene.factor)} ${R.mode ? "" : f.unit} in ${top.link.data.name}` : "");
  if ($("status").textContent !== text) $("status").textContent = text;
  $("meshcat-pane").setAttribute("aria-label", text);
}

/* Names and the peak marker, which follow the points they belong to. */
const screen = V();
function project(x, y, z) {
  screen.set(x, y, z);
  viewer.scene.localToWorld(screen).project(viewer.camera);
  return [(screen.x + 1) / 2 * $("stage").clientWidth, (1 - screen.y) / 2 * $("stage").clientHeight, screen.z];
}
/* "rod_3, 3.1 MPa, 1 % of yield": of a limit set by hand where there is one */
function peakText(b, v, f) {
  const own = S.limit !== DATA.limit && S.limit > 0, strength = own ? S.limit : b.data.strength, share = 100 * Math.abs(v) / strength;
  const of = isStress() && strength > 0 ? `, ${share < 9.5 ? +share.toPrecision(1) : Math.round(share)} % of ${own ? "limit" : "yield"}` : "";
  return `${b.data.name}, ${minus(digits(v))} ${f.unit}${of}`;
}
let marks = [];
function place() {
  if (!R || !scene) return;
  const want = [];
  viewer.camera.updateMatrixWorld();
  const at = (b, i, on) => {                        // a station, or a point of the surface
    const c = on ? b.sweep.position : b.c, j = 3 * (on ? b.sweep.base.of.indexOf(i) : i);
    return project(c[j], c[j + 1], c[j + 2]).slice();
  };
  if (S.names) for (const b of scene.links) want.push(["name", b.data.name, at(b, Math.round(0.3 * (b.m - 1)))]);
  const f = fieldOf(S.field);
  if (S.peak && S.colours && scene.top && f && !R.mode) {
    const v = scene.top.link.now[scene.top.i] * scene.factor;
    if (Math.abs(v) > 0) want.push(["peak" + (S.limit > 0 && isStress() && Math.abs(v) > S.limit ? " over" : ""), peakText(scene.top.link, v, f), at(scene.top.link, scene.top.i, scene.top.link.onSurface(S.field))]);
  }
  while (marks.length < want.length) { const m = el("div"); $("labels").append(m); marks.push(m); }
  marks.forEach((m, i) => {
    m.hidden = i >= want.length;
    if (m.hidden) return;
    const [kind, text, [x, y]] = want[i];
    m.className = "mark " + kind + (x > $("stage").clientWidth - (kind === "name" ? 90 : 7 * text.length + 14) ? " left" : "");
    m.textContent = text;
    m.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
  });
}

/* The value under the pointer: the nearest drawn centreline, in pixels. */
function hover(e) {
  const tip = $("tip"), box = $("stage").getBoundingClientRect(), x = e.clientX - box.left, y = e.clientY - box.top;
  let best = null;
  if (e.buttons === 0 || e.pointerType === "touch") for (const b of scene.links) {
    let p = project(b.c[0], b.c[1], b.c[2]).slice();
    const q0 = project(b.c[0], b.c[1], b.c[2] + b.half), reach = Math.max(9, 1.3 * Math.hypot(q0[0] - p[0], q0[1] - p[1]));
    for (let i = 0; i + 1 < b.m; i++) {
      const q = project(b.c[3 * i + 3], b.c[3 * i + 4], b.c[3 * i + 5]).slice(), dx = q[0] - p[0], dy = q[1] - p[1];
      const u = clamp(((x - p[0]) * dx + (y - p[1]) * dy) / (dx * dx + dy * dy || 1), 0, 1);
      const d = Math.hypot(p[0] + u * dx - x, p[1] + u * dy - y);
      if (d < reach && (!best || d < best.d)) best = {d, b, i, u};
      p = q;
    }
  }
  if (best && best.b.onSurface(S.field) && (best.point = pointAt(best.b, x, y)) === null) best = null;
  tip.hidden = !best;
  if (!best) return;
  const lines = describe(best.b, best.i, best.u, best.point);
  tip.replaceChildren(el("b", {}, lines[0]), ...lines.slice(1).map((s) => el("div", {}, s)));
  tip.style.left = clamp(x + 14, 4, box.width - tip.offsetWidth - 4) + "px";
  tip.style.top = clamp(y + 14, 4, box.height - tip.offsetHeight - 4) + "px";
}
const ray = new THREE.Raycaster();
function pointAt(b, x, y) {                        // of a link's own surface, the point nearest to where the pointer meets it
  ray.setFromCamera({x: 2 * x / $("stage").clientWidth - 1, y: 1 - 2 * y / $("stage").clientHeight}, viewer.camera);
  const {mesh, position, base} = b.sweep, hit = ray.intersectObject(mesh)[0];
  if (!hit) return null;
  const away = (i) => V().fromArray(position, 3 * i).applyMatrix4(mesh.matrixWorld).distanceTo(hit.point);
  return base.of[[hit.face.a, hit.face.b, hit.face.c].sort((i, j) => away(i) - away(j))[0]];
}
function describe(b, i, u, point) {
  const mix = (a) => a[i] * (1 - u) + a[Math.min(i + 1, b.m - 1)] * u, [k, w] = frameOf(S.t), out = [b.data.name];
  out.push(`x = ${digits(1e3 * mix(b.data.x))} of ${digits(1e3 * b.data.length)} mm`);
  for (const f of R.fields) {
    const own = b.onSurface(f.key), n = b.fields[f.key].shape[1], values = lerp(b.fields[f.key], n, k, w, new Float32Array(n));
    if (own && point == null) continue;            // it has no value on the centreline
    const v = own ? values[point] : mix(values);
    out.push(R.mode ? `${f.label} ${minus(digits(v / (Math.abs(peakOf(f.key).value) || 1)))} of largest` : `${f.label} ${minus(digits(v * f.factor))} ${f.unit}`);
  }
  return out;
}

/* ---------------------------------------------------------------- plots under the time bar */
let plots = [];
function drawPlots() {
  const host = $("plots"), list = R && S.plots ? R.plots : [];
  document.body.classList.toggle("plots", list.length > 0);
  host.replaceChildren();
  plots = [];
  const width = innerWidth < 700 ? innerWidth : innerWidth / Math.max(list.length, 1), legends = list.map((p) => named(p, width));
  const boxes = list.map((p, n) => el("figure", {}, el("figcaption", {}, el("b", {}, `${p.title} [${p.unit}]`), el("span", {class: "values"}), legends[n].line)));
  host.append(...boxes);                           // all in place before any is measured
  for (const [n, p] of list.entries()) {
    const box = boxes[n], svg = el("svg", {role: "img", "aria-label": `${p.title} over time`});
    box.append(svg);
    const w = Math.max(box.clientWidth - 12, 60), h = Math.max(box.clientHeight - box.firstChild.offsetHeight - 8, 40), left = 38, right = 6, low = 15, T = R.t;
    svg.setAttribute("viewBox", `0 0 ${w} ${h}`); svg.setAttribute("width", w); svg.setAttribute("height", h);
    let a = 0, b = 0;
    for (const c of p.curves) for (const y of c.y) { if (y < a) a = y; if (y > b) b = y; }
    if (a === b) b = a + 1;
    const step = nice((b - a) / 3.2), y0 = Math.floor(a / step + 1e-6) * step, y1 = Math.ceil(b / step - 1e-6) * step;
    const X = (t) => left + (w - left - right) * (t - T[0]) / (T[T.length - 1] - T[0] || 1), Y = (y) => h - low - (h - low - 5) * (y - y0) / (y1 - y0);
    for (let y = y0; y <= y1 + step / 2; y += step) {
      svg.append(el("line", {x1: left, x2: w - right, y1: Y(y), y2: Y(y), class: Math.abs(y) < step / 2 ? "axis zero" : "axis"}),
        el("text", {x: left - 5, y: Y(y) + 3.5, "text-anchor": "end"}, minus(+(Math.round(y / step) * step).toPrecision(6))));
    }
    const dt = nice((T[T.length - 1] - T[0]) / 4 || 1);
    for (let t = Math.ceil(T[0] / dt - 1e-6) * dt; t <= T[T.length - 1] + dt / 1e3; t += dt)
      svg.append(el("text", {x: X(t), y: h - 3, "text-anchor": t > T[T.length - 1] - dt / 4 ? "end" : "middle"}, `${+t.toPrecision(6)}${t > T[T.length - 1] - dt ? " s" : ""}`));
    const curves = p.curves.slice().sort((c, d) => d.rigid - c.rigid);
    for (const c of curves) {
      let d = "";
      for (let i = 0; i < T.length; i++) d += (i ? "L" : "M") + X(T[i]).toFixed(1) + " " + Y(c.y[i]).toFixed(1);
      svg.append(el("path", {d, stroke: CURVES[c.colour % CURVES.length], class: c.rigid ? "curve rigid" : "curve"}));
    }
    const cursor = el("line", {y1: 3, y2: h - low, class: "cursor"});
    svg.append(cursor);
    const drag = (e) => { if (e.type === "pointerdown" || e.buttons) seek(T[0] + (T[T.length - 1] - T[0]) * (e.clientX - svg.getBoundingClientRect().left - left) / (w - left - right)); };
    svg.addEventListener("pointerdown", drag); svg.addEventListener("pointermove", drag);
    plots.push({p, cursor, X, values: box.querySelector(".values"), names: legends[n].names});
  }
  movePlots();
}
/* Names of a plot's curves: before their values where there is room, without what all have in common
   where there is less, in a line of their own where there is little, without values where those do not fit either. */
function named(p, width) {
  const some = p.curves.filter((c) => !c.rigid).slice(0, 8), full = some.map((c) => c.name), rigid = p.curves.some((c) => c.rigid);
  const line = (...parts) => parts.length ? el("span", {class: "names"}, ...parts) : null, dash = rigid ? [el("span", {class: "dash"}, "┄ rigid")] : [];
  const longest = (y) => { let n = 0; for (let i = 0; i < y.length; i += 1 + (y.length >> 6)) n = Math.max(n, digits(y[i]).length); return n; };
  const widths = some.reduce((n, c) => n + longest(c.y) + 2.5, 0);   // of the whole run: nothing jumps as it plays
  if (some.length < 2) return {names: [""], line: line(...dash)};
  const room = width / 6.4 - p.title.length - p.unit.length - 6, fits = (names) => names.join("").length + widths < room;
  const common = (names) => { let n = 0; while (names.every((s) => n < s.length && s[n] === names[0][n])) n++; return n; };
  const head = full[0].slice(0, common(full)).match(/^.*[_\W]/) || [""], back = (s) => [...s].reverse().join("");
  const tail = full[0].slice(full[0].length - common(full.map(back))).match(/[_\W].*$/) || [""];
  const brief = full.map((s) => s.slice(head[0].length, s.length - tail[0].length)), short = brief.every((s) => /[a-z]/i.test(s)) ? brief : full;
  for (const names of [full, short]) if (fits(names)) return {names, line: line(...dash)};
  return {names: 0.9 * widths < room ? some.map(() => "") : null, line: line(...dash, ...some.map((c, i) => el("span", {style: `color:${CURVES[c.colour % CURVES.length]}`}, short[i])))};
}
function movePlots() {
  if (!plots.length) return;
  const [k, w] = frameOf(S.t);
  for (const {p, cursor, X, values, names} of plots) {
    cursor.setAttribute("x1", X(S.t)); cursor.setAttribute("x2", X(S.t));
    if (!names) continue;
    const some = p.curves.filter((c) => !c.rigid).slice(0, 8);
    const texts = some.map((c) => minus(digits(c.y[k] * (1 - w) + (w > 0 ? c.y[k + 1] * w : 0))));
    values.replaceChildren(...some.map((c, i) => el("span", {style: `color:${CURVES[c.colour % CURVES.length]}`, title: c.name}, (names[i] ? names[i] + " " : "") + texts[i])));
  }
}

