/* labels.js: texts that follow the time: readings, names, the peak, values at arrows. */
const clockDigits = () => clamp(Math.ceil(-Math.log10(Math.max(R.t[R.t.length - 1] - R.t[0], 1e-9))) + 3, 1, 6);
function clock(t) {
  const [a, b] = [R.t[0], R.t[R.t.length - 1]];
  return R.mode ? `phase ${Math.round(360 * (t - a) / (b - a))}°` : `${t.toFixed(clockDigits())} s`;
}
function deviationText(at) {
  const {name, off, deviation, factor, unit, angle, angle_factor, angle_unit} = R.track, a = mixed(angle, at), p = S.diff && otherRun() && plots.find((q) => q.p.apart);
  if (p) return `${name}: ${digits(mixed(p.p.curves[0].y, at))} ${unit} off ${otherName()}`;
  return `${name}: ${digits(factor * mixed(deviation, at))} ${unit}${a > 0 ? `, ${digits(angle_factor * a)} ${angle_unit}` : ""} off ${off}`;
}
function refresh(at) {
  const end = R.t[R.t.length - 1], time = $("time");
  time.value = S.t;
  time.setAttribute("aria-valuetext", clock(S.t));
  $("clock").textContent = R.mode ? clock(S.t) : `${S.t.toFixed(clockDigits())} / ${end.toFixed(clockDigits())} s`;
  const parts = [];
  if (scene.moves) parts.push(el("span", {class: "mag"}, R.mode ? "shape, not to scale" : `deflection ×${+S.mag.toPrecision(3)}`));
  parts.push(el("span", {}, R.mode ? clock(S.t) : `t = ${clock(S.t)}`));
  if (R.track && !R.mode && maxAbs(R.track.deviation) > 0) parts.push(el("span", {}, deviationText(at)));
  $("readout").replaceChildren(...parts);
  scene.top = null;
  for (const b of scene.links) for (let i = 0; i < b.now.length; i++)
    if (!scene.top || Math.abs(b.now[i]) > Math.abs(scene.top.link.now[scene.top.i])) scene.top = {link: b, i};
  movePlots(at);
  moveTable(at);
  moveBeam(at);
}
function announce() {                              // for a screen reader, when the motion rests
  if (S.play || !R) return;
  const f = fieldOf(S.field), top = scene.top;
  const text = `${DATA.title}, ${DATA.runs.length > 1 ? runLabel(R, S.run) + ", " : ""}${clock(S.t)}, magnification ${S.mag}` +
    (f && top ? `, ${f.label} at most ${digits(Math.abs(top.link.now[top.i]) * scene.factor)} ${R.mode ? "" : f.unit} in ${top.link.data.name}` : "");
  if ($("status").textContent !== text) say(text);
  $("pane").setAttribute("aria-label", text);
}

/* What to know before believing the picture; the whole sentence on a click. */
function showVerdicts() {
  const chips = R.verdicts.map(({kind, text, why}) => {
    const mark = {bad: "✕ ", care: "⚠ ", plain: ""}[kind], whole = why && why !== text ? `${text}: ${why}` : text;
    const chip = button(mark + text, () => {
      const open = chip.getAttribute("aria-expanded") !== "true";
      chip.setAttribute("aria-expanded", open);
      chip.textContent = mark + (open ? whole : text);
    }, {class: "chip " + kind, title: whole, "aria-expanded": "false"});
    return chip;
  }), first = small.matches ? 2 : 4, rest = chips.slice(first);
  for (const chip of rest) chip.hidden = true;
  const more = rest.length ? button(`+ ${rest.length}`, () => { rest.forEach((chip) => { chip.hidden = false; }); more.remove(); rest[0].focus(); },
    {class: "chip plain", "aria-label": `${rest.length} more verdicts`}) : null;
  $("chips").replaceChildren(...chips, ...(more ? [more] : []));
}

/* ---------------------------------------------------------------- marks over the drawing */
const screen = V();
function project(x, y, z) {
  const [w, h] = viewer.size;                      // asked of the page, it would be laid out once more
  screen.set(x, y, z).project(viewer.camera);
  return [(screen.x + 1) / 2 * w, (1 - screen.y) / 2 * h, screen.z];
}
/* "rod_3, 3.1 MPa, 1 % of yield": of a limit set by hand where there is one */
function peakText(b, v, f) {
  const own = S.limit !== DATA.limit && S.limit > 0, strength = own ? S.limit : b.data.strength, share = 100 * Math.abs(v) / strength;
  const of = isStress() && strength > 0 ? `, ${share < 9.5 ? +share.toPrecision(1) : Math.round(share)} % of ${own ? "limit" : "yield"}` : "";
  return `${b.data.name}, ${minus(digits(v))} ${f.unit}${of}`;
}
function wantedMarks() {
  const want = [], f = fieldOf(S.field);
  const at = (b, i, on) => {                        // a station, or a point of the surface
    const c = on ? b.sweep.position : b.c, j = 3 * (on ? b.sweep.base.of.indexOf(i) : i);
    return project(c[j], c[j + 1], c[j + 2]).slice();
  };
  if (S.peak && S.colours && scene.top && f && !R.mode) {
    const v = scene.top.link.now[scene.top.i] * scene.factor, limit = limitShown();
    if (Math.abs(v) > 0) want.push(["peak" + (limit && Math.abs(v) > limit ? " over" : ""), peakText(scene.top.link, v, f), at(scene.top.link, scene.top.i, scene.top.link.onSurface(sourceOf(S.field)))]);
  }
  if (ghost && S.ghost === "beside") for (const [text, shift] of [[DATA.runs.length > 1 ? runLabel(R, S.run) : "flexible", V(0, 0, 0)], [otherName(), scene.aside]])
    want.push(["title", text, project(...V().copy(scene.crown).add(shift).toArray()).slice()]);
  if (S.names) for (const b of scene.links) want.push(["name", b.data.name, at(b, Math.round(0.3 * (b.m - 1)))]);
  for (const [kind, list, unit] of [["force", scene.forces, () => "N"], ["torque", scene.torques, (a) => a.data.linear ? "N" : "N m"]]) {
    const most = Math.max(...list.map((a) => Math.abs(a.size)));
    for (const a of list.slice().sort((p, q) => Math.abs(q.size) - Math.abs(p.size)))
      if (a.tip && Math.abs(a.size) > 0.02 * most) want.push([kind, `${minus(digits(a.size))} ${unit(a)}`, project(a.tip.x, a.tip.y, a.tip.z).slice()]);
  }
  return want;
}
let marks = [];
const OUT = 20;                                    // [px] beyond the edge: what stands there is out of sight
function place() {
  if (!R || !scene) return;
  viewer.camera.updateMatrixWorld();
  const want = wantedMarks(), [wide] = viewer.size, taken = [];
  while (marks.length < want.length) { const m = el("div"); $("labels").append(m); marks.push(m); }
  marks.forEach((m, i) => {
    m.hidden = i >= want.length || want[i][0] !== "peak" && Math.abs(want[i][2][0] - wide / 2) > wide / 2 + OUT;
    if (m.hidden) return;
    let [kind, text, [x, y]] = want[i];
    const length = kind === "name" ? 90 : 7 * text.length + 14;
    const over = Math.max(0, x + length + 8 - wide), left = over > (kind === "peak" ? length / 2 : 0) && x - length > (small.matches ? 120 : 0);   // not over the legend; the peak's stands above its ring, and may be shifted
    const shift = left ? 0 : over, half = kind === "title" ? length / 2 : 0, from = left ? x - length : x - half - shift, box = [from, y - (kind === "peak" ? 30 : 20), from + length, y - 4];
    const covers = (b) => box[0] < b[2] && b[0] < box[2] && box[1] < b[3] && b[1] < box[3];
    const low = kind === "peak" && covers(headBox);   // then it stands below its ring
    if (low) { box[1] += 42; box[3] += 42; }
    if (kind === "title") { const up = taken.some(covers) ? 20 : 0; y -= up; box[1] -= up; box[3] -= up; }
    m.className = "mark " + kind + (left ? " left" : "") + (low ? " low" : "");
    if (kind === "force" || kind === "torque") {    // the largest first; a value that would cover another is left out
      m.hidden = [headBox, ...taken].some(covers);
      if (m.hidden) return;
    }
    taken.push(box);
    m.textContent = text;
    m.style.setProperty("--shift", `${shift}px`);
    const inside = kind === "peak" ? x : clamp(x, left ? length : half, Math.max(wide - (left ? 0 : half || length), half));
    m.style.transform = `translate(${inside.toFixed(1)}px, ${y.toFixed(1)}px)`;
  });
}
