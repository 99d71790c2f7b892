/* live.js: sliders in the page, whose every move is a run of its own (worker.js). */
const live = {ready: false, settings: {}, sent: 0, shown: 0, timer: null, worker: null, rows: {}, pieces: {}, asked: {}, waits: {}};

function livePanel() {
  const sliders = DATA.live.sliders.map((s) => {
    live.settings[s.name] = s.value;
    const output = el("output", {for: "live-" + s.name, class: "live-value"});
    const range = s.acts === "motion" ? {type: "checkbox"} : {type: "range", min: s.low, max: s.high, step: (s.high - s.low) / 200, value: s.value};
    const input = el("input", {id: "live-" + s.name, disabled: true, ...range, oninput: () => {
      live.settings[s.name] = s.acts === "motion" ? +input.checked : +input.value;
      for (const row of Object.values(live.rows)) showSlider(row.s, row.input, row.output);
      ask();
    }});
    live.rows[s.name] = {s, input, output};
    showSlider(s, input, output);
    return el("div", {class: "live-row"}, el("label", {for: "live-" + s.name}, s.label), output, input);
  });
  /* A section may be changed one way only: the other way its links are built otherwise. */
  const half = (s) => s.acts !== "section" || s.low < s.value && s.value < s.high ? [] : [`${s.label} ${s.low < s.value ? "above" : "below"} ${shownValue(s, s.value)}`];
  const why = [...Object.keys(DATA.live.left_out), ...DATA.live.sliders.flatMap(half)];
  return el("aside", {id: "live", class: "side", "aria-label": "sliders"},
    el("header", {}, el("h2", {}, "Try"), el("div", {class: "tools"}, button("✕", () => openLive(false), {"aria-label": "close sliders", id: "live-close"})),
      el("p", {id: "live-status", role: "status"}, "loading …")),
    ...sliders,
    el("div", {class: "live-tools"}, button("Reset", resetLive, {id: "live-reset"}), button("Copy as --set", copyLive, {id: "live-copy", title: "the command that solves just this"})),
    el("p", {class: "soft"}, "Every change runs level coupled here, in this page: nothing is sent anywhere."),
    why.length ? el("p", {class: "soft"}, `By the command line alone: ${why.join(", ")} (pinflex solve ${DATA.live.model} --set …).`) : null);
}
function openLive(open) {
  $("live").hidden = !open;
  document.body.classList.toggle("trying", open);
  $("live-open").setAttribute("aria-expanded", String(open));
  if (open) set({link: null, table: false});        // one panel at a time
  layoutChanged();
  (open ? $("live-close") : $("live-open")).focus({preventScroll: true});
}
function showSlider(s, input, output) {
  const on = shaperOf(s), text = s.acts !== "motion" ? shownValue(s, live.settings[s.name]) : on ? `${on.kind}, ${digits(on.frequencies[0])} ${s.unit}` : "off";
  output.textContent = text;
  if (s.acts !== "motion") input.setAttribute("aria-valuetext", text);
}
const shownValue = ({shown, unit}, p) => unit === "times" ? "×" + digits(shown * p) : `${digits(shown * p)} ${unit}`;
/* The shaper of the motion where it is on: the speed of the move stretches it, too. */
function shaperOf(s) {
  if (s.acts !== "motion" || live.settings[s.name] < 0.5) return null;
  const value = s.keys[0][1];
  return {...value, frequencies: value.frequencies.map((f) => f * (live.settings.speed ?? 1))};
}
/* Overrides that make a run of the command line the same: in 15 digits, as products have tails. */
function overrides() {
  const out = [], text = (value) => JSON.stringify(value, (key, x) => typeof x === "number" ? +x.toPrecision(15) : x);
  for (const s of DATA.live.sliders) {
    const p = live.settings[s.name], on = shaperOf(s);
    if (on) out.push(`${s.keys[0][0]}=${text(on)}`);
    if (p === s.value || s.acts === "motion") continue;
    const times = (x, f) => typeof x === "number" ? x * f : Array.isArray(x) ? x.map((y) => times(y, f)) : x && typeof x === "object" ? Object.fromEntries(Object.entries(x).map(([k, y]) => [k, times(y, f)])) : x;
    for (const [key, value, power] of s.keys) out.push(`${key}=${text(times(value, p ** power))}`);
  }
  return out;
}
const commandLine = () => [`pinflex solve ${DATA.live.model} --level coupled --tol ${DATA.live.tol}`, ...overrides().map((x) => `--set '${x}'`)].join(" ");
async function copyLive() {
  const text = commandLine();
  try { await navigator.clipboard.writeText(text); liveSays("copied"); } catch (e) {
    const area = el("textarea", {readonly: true, rows: 4, "aria-label": "command"});
    area.value = text;
    $("live-copy").after(area);
    area.select();
    area.addEventListener("blur", () => area.remove());
  }
}
const resetLive = () => moveSliders(Object.fromEntries(DATA.live.sliders.map((s) => [s.name, s.value])));
function moveSliders(settings) {
  for (const [name, value] of Object.entries(settings)) {
    const {s, input} = live.rows[name];
    live.settings[name] = value;
    if (s.acts === "motion") input.checked = value >= 0.5;
    else input.value = value;
  }
  for (const {s, input, output} of Object.values(live.rows)) showSlider(s, input, output);
  ask();
}
const liveSays = (text) => { $("live-status").textContent = text; };

function ask() {
  live.asked[++live.sent] = performance.now();
  computing(true);
  live.worker.postMessage({id: live.sent, settings: {...live.settings}});
}
/* While the other thread works there is less time to draw. */
function computing(busy) {
  document.body.classList.toggle("computing", viewer.busy = busy);
}
function hear({data}) {
  if (data.ready) { live.ready = true; for (const s of DATA.live.sliders) live.rows[s.name].input.disabled = false; liveSays("ready"); return; }
  if (data.failed && !live.ready) { stopLive(data.failed); return; }
  if (data.id < live.shown || data.id === undefined) return;
  if (data.failed) { if (data.id === live.sent) { computing(false); liveSays(`No run: ${data.failed}. The picture is the last run; the command line says more: ${commandLine()}`); } return; }
  live.shown = data.id;
  live.times = {...(data.part === "torque" ? {} : live.times), [data.part]: data.took};
  if (S.run !== DATA.live.run) show(DATA.live.run);   // of several it is this one that sliders change
  live.got = {...(live.got && live.got.id === data.id ? live.got : {}), ...data};
  live[data.part](data);
}
live.torque = (d) => {
  const share = (S.t - R.t[0]) / (R.t[R.t.length - 1] - R.t[0] || 1), motors = DATA.live.motors, n = motors.length;
  R.t = Array.from(d.t);
  motors.forEach((name, i) => {
    const y = Float32Array.from(R.t, (_, k) => d.torque[k * n + i]);
    for (const p of R.plots) for (const c of p.curves) if (c.name === name && !c.rigid && /^motor/.test(p.title)) c.y = y;
    for (const a of R.torques) if (a.name === name) a.value = y;
  });
  for (const p of R.plots) p.curves = p.curves.filter((c) => !c.rigid);     // of other settings
  $("time").min = R.t[0]; $("time").max = R.t[R.t.length - 1];
  if (S.zoom) S.zoom = null;
  S.t = R.t[0] + share * (R.t[R.t.length - 1] - R.t[0]);
  soon("plots", curves);
  liveSays("shape …");
};
live.shape = (d) => {
  if (d.rigid) movedRigid(d.rigid);
  for (const k of R.links) { const x = d.links[k.name]; for (const name of ["disp", "y_disp", "y_rigid"]) k[name] = Object.assign(x[name], {shape: k[name].shape}); }
  for (const b of R.bodies) if (d.bodies[b.name] && b.disp) b.disp = Object.assign(d.bodies[b.name], {shape: b.disp.shape});
  if (d.track && R.track) Object.assign(R.track, {disp: Object.assign(d.track.disp, {shape: R.track.disp.shape}), deviation: d.track.deviation, angle: d.track.angle});
  for (const p of R.plots) if (p.deviation && d.track) p.curves[0].y = d.track.deviation.map((x) => R.track.factor * x);
  scene.away = {};
  for (const b of scene.links) b.away = {};
  R.largest = Math.max(0, ...R.links.map((k) => maxAbs(k.disp)));
  soon("path", drawPath);
  live.afresh();
  liveSays("stresses …");
};
/* The rigid robot that deflections are drawn from, where the motion is another one. */
function movedRigid(rigid) {
  for (const k of R.links) {
    const [n, m] = k.rigid.shape, line = rigid.links[k.name], all = line.length / (3 * n);
    for (let i = 0; i < n; i++) for (let j = 0; j < m; j++) k.rigid.set(line.subarray(3 * (i * all + (m === 2 && j ? all - 1 : j)), 3 * (i * all + (m === 2 && j ? all - 1 : j)) + 3), 3 * (i * m + j));
  }
  const put = (to, from) => { if (to && from && to.length === from.length) to.set(from); };
  for (const b of R.bodies) put(b.rigid, rigid.bodies[b.name]);
  for (const f of R.forces) put(f.rigid, rigid.joints[f.name]);
  if (R.track) put(R.track.rigid, rigid.track);
}
live.stress = (d) => {
  for (const k of R.links) {
    for (const key of Object.keys(k.fields)) if (d.fields[k.name][key]) k.fields[key] = Object.assign(d.fields[k.name][key], {shape: k.fields[key].shape});
    for (const key of Object.keys(k.sections)) k.sections[key] = Object.assign(d.sections[k.name][key], {shape: k.sections[key].shape});
  }
  for (const f of R.forces) if (d.joints[f.name]) Object.assign(f, {vector: Object.assign(d.joints[f.name].vector, {shape: f.vector.shape}), disp: Object.assign(d.joints[f.name].disp, {shape: f.disp.shape})});
  for (const p of R.plots) if (p.unit === "MPa") for (const c of p.curves) {
    const k = R.links.find((x) => x.name === c.name), f = k && k.fields.von_mises;
    if (f) c.y = Float32Array.from(R.t, (_, i) => { let m = 0; for (let j = i * f.shape[1]; j < (i + 1) * f.shape[1]; j++) m = Math.max(m, f[j]); return 1e-6 * m; });
  }
  soon("fields", fieldsOf(scene.links));
};
const fieldsOf = ([link, ...others]) => () => {     // one link a piece
  link.fields = linkFields(link.data, R.t.length);
  if (others.length) { soon("fields", fieldsOf(others)); return; }
  scene.peaks = {};
  soon("colours", setColours);
  live.afresh();
};
live.error = (d) => {
  const worst = Math.max(...Object.values(d.error)), percent = (x) => `${digits(100 * x, 2)} %`;
  const told = [{kind: worst > 4 * DATA.live.tol ? "care" : "plain", text: `time integration ±${percent(worst)}${worst > 20 * DATA.live.tol ? ": too much to judge by" : ""}`, why: `${Object.entries(d.error).map(([what, x]) => `${what} ±${percent(x)}`).join(", ")}: twice what a second correction of every step shows`}];
  if (d.told > 1e-9) told.push({kind: d.told > 1e-3 ? "care" : "plain", text: `tables ±${percent(d.told)}`, why: "tables between those that were made beforehand, of their largest entry"});
  for (const k of R.links) {
    const most = 1e-6 * maxAbs(k.fields.von_mises || [0]);
    if (k.strength > 0 && most > k.strength) told.unshift({kind: "bad", text: `${k.name} beyond yield`, why: `${digits(most)} MPa, yield ${digits(k.strength)} MPa`});
  }
  R.verdicts = told;
  soon("verdicts", () => {
    const tall = $("head").offsetHeight;
    showVerdicts();
    if ($("head").offsetHeight !== tall) layoutChanged();   // labels keep clear of it
  });
  soon("done", () => {
    computing(false);
    liveSays(`solved here in ${Math.round(d.took)} ms, ${live.got.steps} steps`);
    live.done = d.id;
  });
};
/* What is drawn of the run, again. */
live.afresh = () => {
  soon("plots", curves);
  soon("table", openTable);
  soon("beam", openBeam);
  if (!S.play) soon("seek", () => seek(S.t));       // else every frame does
};
function curves() {
  const done = drawChanged();                       // torques first
  live.waits[live.shown] ??= performance.now() - live.asked[live.shown];   // for who measures
  if (!done) soon("plots", curves);
}
/* Pieces of drawing by name, each once, as many in a frame of the animation as it has time for. */
const pieces = new Map(), SHARE = 6;                // [ms]
function soon(name, piece) {
  if (!pieces.size) requestAnimationFrame(somePieces);
  pieces.set(name, piece);
}
function somePieces() {
  const until = performance.now() + SHARE;
  for (const [name, piece] of pieces) {
    pieces.delete(name);
    const began = performance.now();
    piece();
    (live.pieces[name] = live.pieces[name] || []).push(performance.now() - began);
    if (performance.now() > until) break;
  }
  if (pieces.size) requestAnimationFrame(somePieces);
}
function stopLive(why) {
  for (const s of DATA.live.sliders) live.rows[s.name].input.disabled = true;
  liveSays(`This browser plays the run, but cannot compute (${why}).`);
}

async function startLive() {
  $("dock").before(livePanel());
  $("tools").prepend(button("Try", () => openLive($("live").hidden), {id: "live-open", "aria-controls": "live", title: "change the robot and run it again"}));
  $("live").hidden = small.matches;               // there the drawing comes first
  document.body.classList.toggle("trying", !small.matches);
  $("live-open").setAttribute("aria-expanded", String(!small.matches));
  layoutChanged();
  try {
    if (!window.WebAssembly || !window.Worker) throw new Error("no WebAssembly");
    const all = await inflated("pinflex-live"), view = new DataView(all.buffer, all.byteOffset), pieces = [];
    for (let at = 0; at < all.length;) { const n = view.getUint32(at, true); pieces.push(all.subarray(at + 4, at + 4 + n)); at += 4 + n; }
    const [wasm, script, head, planes] = pieces, n = planes.length / 8, bytes = new Uint8Array(planes.length);
    for (let p = 0; p < 8; p++) for (let i = 0; i < n; i++) bytes[8 * i + p] = planes[p * n + i];
    live.worker = new Worker(URL.createObjectURL(new Blob([script], {type: "text/javascript"})));
    live.worker.onmessage = hear;
    live.worker.onerror = (e) => stopLive(e.message || "no worker");
    const header = JSON.parse(new TextDecoder().decode(head)), values = new Float64Array(bytes.buffer);
    live.worker.postMessage({wasm: wasm.slice(), header, values});
    Object.assign(live, {sliders: DATA.live.sliders, overrides, commandLine, move: moveSliders});
    window.pinflex.live = live;                     // what a script may ask
  } catch (error) { stopLive(error.message); }
}
startLive();
