/* player.js: controls, keys, pictures and films, and the start. */
/* ---------------------------------------------------------------- control */
function set(change) {
  Object.assign(S, change);
  if (R) {
    if ("play" in change) { last = null; if (S.play && S.t >= R.t[R.t.length - 1]) S.t = R.t[0]; }
    setColours();
    if ("plots" in change || "ui" in change) { document.body.classList.toggle("bare", !S.ui); drawPlots(); viewer.set_3d_pane_size(); }
    if ("ghost" in change) { if (!cameraMoved) fitCamera(); }
    if ("mag" in change) drawPath();
    seek(S.t);
  }
  showControls();
  announce();
}
function showControls() {
  const play = $("play");
  play.textContent = S.play ? "❚❚" : "▶";
  play.setAttribute("aria-label", S.play ? "pause" : "play");
  play.setAttribute("aria-pressed", S.play);
  for (const k of ["colours", "path", "force", "torque", "names", "peak", "plots", "loop"]) $("opt-" + k).checked = S[k];
  for (const [k, has] of [["force", scene.forces.length], ["torque", scene.torques.length], ["path", scene.path], ["plots", R.plots.length], ["colours", R.fields.length], ["peak", R.fields.length && !R.mode], ["names", scene.links.length]]) {
    $("opt-" + k).disabled = !has;
    if (!has) $("opt-" + k).checked = false;
  }
  for (const k of ["field", "map", "ghost", "speed"]) if ($(k).value !== String(S[k])) $(k).value = String(S[k]);
  $("limit").value = S.limit > 0 ? S.limit : "";
  $("max").value = S.max > 0 ? S.max : "";
  $("max").placeholder = digits(fieldMax());
  const near = scene.steps.reduce((b, v, i) => Math.abs(v - S.mag) < Math.abs(scene.steps[b] - S.mag) ? i : b, 0);
  $("mag").max = scene.steps.length - 1;
  $("mag").value = near;
  $("mag").setAttribute("aria-valuetext", `times ${S.mag}`);
  $("mag-number").value = +S.mag.toPrecision(4);
  $("mag").disabled = $("mag-number").disabled = !scene.moves;
}
function worst() {
  const p = peakOf(S.field);
  if (!p.link) return;
  S.play = false;
  seek(R.t[p.frame]);
  set({peak: true});
}
function step(n) { S.play = false; const [k, w] = frameOf(S.t); seek(R.t[clamp(k + n + (n < 0 && w > 0 ? 1 : 0), 0, R.t.length - 1)]); showControls(); announce(); }
function stepMag(n) {
  const s = scene.steps, i = s.findIndex((v) => v >= S.mag - 1e-9);
  setMag(s[clamp((i < 0 ? s.length - 1 : i) + n, 0, s.length - 1)]);
}
function keys(e) {
  if (e.ctrlKey || e.metaKey || e.altKey) return;
  const typing = e.target.matches("input[type=number], select, textarea"), range = e.target.matches("input[type=range]");
  const button = e.target.matches("button, summary, input[type=checkbox]");
  if (typing || (e.key === " " && button) || (range && /^(Arrow|Home|End)/.test(e.key))) return;
  const n = e.shiftKey ? 10 : 1;
  const act = {" ": () => set({play: !S.play}), ArrowRight: () => step(n), ArrowLeft: () => step(-n), Home: () => step(-1e9), End: () => step(1e9),
    "+": () => stepMag(1), "=": () => stepMag(1), "-": () => stepMag(-1), w: worst, n: () => set({names: !S.names}), f: () => set({force: !S.force}),
    g: () => set({ghost: {over: "beside", beside: "off", off: "over"}[S.ghost]})}[e.key];
  if (act) { act(); e.preventDefault(); }
}

let last = null;
function tick(now) {
  requestAnimationFrame(tick);
  if (!S.play || !R) { last = null; return; }
  if (last !== null) {
    const a = R.t[0], b = R.t[R.t.length - 1];
    let t = S.t + Math.min(now - last, 250) / 1e3 * S.speed;   // a sleeping tab does not jump
    if (t >= b && !S.loop) { S.play = false; t = b; showControls(); announce(); }
    else if (t > b) t = b > a ? a + ((t - a) % (b - a)) : a;
    seek(t);
  }
  last = now;
}

/* ---------------------------------------------------------------- pictures */
function image() {                                 // the drawing with its legend, as a data URL
  viewer.render();
  const from = viewer.renderer.domElement, c = document.createElement("canvas"), g = c.getContext("2d"), s = from.width / from.clientWidth;
  c.width = from.width; c.height = from.height;
  g.drawImage(from, 0, 0);
  g.scale(s, s);
  g.fillStyle = "#1b2430"; g.font = "600 16px system-ui, sans-serif"; g.fillText(DATA.title, 20, 32);
  g.font = "13px system-ui, sans-serif"; g.fillText($("readout").innerText.replace(/\s*\n\s*/g, "  ·  "), 20, 52);
  const f = fieldOf(S.field);
  if (f && S.colours) {
    const top = legendMax(), low = scene.signed ? -top : 0;
    g.fillText(`${f.label} ${R.mode ? "(relative)" : `[${f.unit}]`}`, 20, 84);
    for (let i = 0; i < 180; i++) { g.fillStyle = `rgb(${colourOf(top + (low - top) * i / 179)})`; g.fillRect(20, 94 + i, 16, 1.5); }
    g.fillStyle = "#1b2430";
    for (const [v, text] of legendTicks()) g.fillText(text, 42, 98 + 180 * (top - v) / (top - low));
  }
  g.font = "600 13px system-ui, sans-serif";
  for (const m of marks) if (!m.hidden) { const [, x, y] = m.style.transform.match(/([\d.-]+)px, ([\d.-]+)px/); g.fillText(m.textContent, +x + 10, +y - 8); if (m.classList.contains("peak")) ring(g, +x, +y); }
  return c.toDataURL("image/png");
}
function ring(g, x, y) {
  for (const [width, colour] of [[5, "rgba(255, 255, 255, .85)"], [2, "#1b2430"]]) { g.lineWidth = width; g.strokeStyle = colour; g.beginPath(); g.arc(x, y, 5, 0, 2 * Math.PI); g.stroke(); }
}
function save(name, url) { el("a", {href: url, download: name}).click(); }
function savePicture() { save(`${DATA.file}.png`, image()); }
function film() {
  const canvas = viewer.renderer.domElement;
  if (!canvas.captureStream || !window.MediaRecorder) { $("status").textContent = "this browser cannot record"; return; }
  const parts = [], recorder = new MediaRecorder(canvas.captureStream(30)), loop = S.loop;
  recorder.ondataavailable = (e) => parts.push(e.data);
  recorder.onstop = () => { save(`${DATA.file}.webm`, URL.createObjectURL(new Blob(parts, {type: recorder.mimeType}))); $("film").classList.remove("on"); };
  $("film").classList.add("on");
  seek(R.t[0]);
  set({loop: false, play: true});
  recorder.start();
  const wait = setInterval(() => { if (!S.play) { clearInterval(wait); recorder.stop(); set({loop}); } }, 100);
}

/* ---------------------------------------------------------------- start */
function show(index, from = {}) {
  if (R) { viewer.delete_path(["robot"]); viewer.delete_path(["rigid"]); }
  S.run = index;
  R = DATA.runs[index];
  scene = makeScene(R);
  viewer.set_object(["robot"], scene.root);
  viewer.set_object(["rigid"], scene.soft);
  const span = R.t[R.t.length - 1] - R.t[0] || 1, speed = R.mode ? span / 1.6 : nice(span / 6);
  if ($("run")) $("run").value = index;
  $("sub").textContent = R.mode ? `natural frequency ${digits(R.mode.frequency, 4)} Hz` : R.level;
  $("remark").textContent = R.remark ? "⚠ " + R.remark : "";
  $("remark").title = R.remark || "";
  $("field").replaceChildren(...R.fields.map((f) => el("option", {value: f.key}, f.label)));
  const option = [...$("speed").options];
  if (!option.some((o) => +o.value === speed)) $("speed").append(el("option", {value: speed}, R.mode ? "1 period in 1.6 s" : "×" + speed));
  Object.assign(S, {mag: R.scale, speed, max: null, field: fieldOf(S.field) ? S.field : (R.fields[0] || {}).key});
  if (R.mode) S.field = "displacement";
  else if (!from.field && fieldOf(DATA.field)) S.field = DATA.field;
  Object.assign(DEFAULT, S, {max: null});
  Object.assign(S, from);
  if (!fieldOf(S.field)) S.field = (R.fields[0] || {}).key;
  if (!scene.moves) { S.mag = 1; S.ghost = "off"; }   // nothing to compare with
  document.body.classList.toggle("bare", !S.ui);
  document.body.classList.toggle("rigid", !scene.moves);
  document.body.classList.toggle("mode", !!R.mode);
  $("time").min = R.t[0]; $("time").max = R.t[R.t.length - 1];
  scene.factor = 1;
  setColours();
  scene.aside = V(0, 0, 0);
  const ghost = S.ghost;
  S.ghost = "over";
  const points = cloud(), low = points[0].clone(), high = low.clone();
  points.forEach((p) => { low.min(p); high.max(p); });
  const e = V().subVectors(high, low), flat = e.z < 0.15 * Math.max(e.x, e.y);
  const right = V(0, 0, 1).cross(viewFrom(e)).normalize(), across = points.map((p) => p.dot(right));
  scene.extent = e;
  scene.aside.copy(right).multiplyScalar(1.12 * (Math.max(...across) - Math.min(...across)));   // seen as large as the robot
  S.ghost = ghost;
  const cell = light(scene.size, V().addVectors(low, high).multiplyScalar(0.5), low.z - (flat ? 0.05 : 0.12) * scene.size);
  const notes = [...scene.notes, `grid ${digits(1e3 * cell, 3)} mm`];
  if (scene.moves && !R.mode) notes.unshift("deflections are magnified about the rigid pose; ×1 is true, ×0 rigid");
  $("notes").textContent = notes.join(" · ");
  drawPlots();
  viewer.set_3d_pane_size();
  drawPath();
  if (from.cam) {
    cameraMoved = true;
    fitCamera();
    viewer.camera.position.set(...from.cam.slice(0, 3)); viewer.controls.target.set(...from.cam.slice(3)); viewer.controls.update();
  } else if (!cameraMoved) fitCamera();
  /* a run opens where it is furthest from rigid, at rest; one that plays begins at the beginning */
  const opening = R.mode ? S.t : from.play ? R.t[0] : R.opens;
  S.t = clamp(from.t ?? opening ?? S.t, R.t[0], R.t[R.t.length - 1]);
  set({play: S.play && !reduced});
}

function start() {
  buildPage();
  const wish = (new URLSearchParams(location.hash.slice(1)).get("size") || "").match(/^(\d+)x(\d+)$/);
  if (wish) Object.assign($("app").style, {width: wish[1] + "px", height: wish[2] + "px"});  // a film of that size in any window
  if (matchMedia("(min-width: 900px)").matches) $("options").open = false;
  makeViewer();
  const from = readHash();
  if (from.run === undefined && DATA.runs[0].mode && from.play === undefined) from.play = true;
  show(from.run || 0, from);
  addEventListener("keydown", keys);
  $("stage").addEventListener("pointermove", hover);
  $("stage").addEventListener("pointerdown", hover);
  $("stage").addEventListener("pointerleave", () => { $("tip").hidden = true; });
  addEventListener("hashchange", () => { if (location.hash !== ownHash) { const h = readHash(); if (h.run !== undefined && h.run !== S.run) show(h.run, h); else set(h); } });
  requestAnimationFrame(tick);
  const link = (name) => scene.links.find((b) => b.data.name === name);
  window.pinflex = {
    ready: false, seek: (t) => { seek(t); announce(); }, setMag, set, worst, image, show,
    get state() { return {...S, frames: R.t.length, duration: R.t[R.t.length - 1], name: R.name, steps: scene.steps.slice()}; },
    get legend() { return {min: scene.signed ? -legendMax() : 0, max: legendMax(), unit: fieldOf(S.field)?.unit, field: S.field}; },
    get links() { return scene.links.map((b) => b.data.name); },
    centreline: (name) => Array.from(link(name).c),
    surface: (name) => Array.from(link(name).sweep.position),
    values: (name) => Array.from(link(name).now, (v) => v * scene.factor),
    describe: (name, i) => describe(link(name), i, 0),
    point: (body, i) => { const b = scene.bodies.find((x) => x.data.name === body); return V(...b.data.points[i]).applyMatrix4(b.matrix).toArray(); },
    pixel: (name, i) => { const b = link(name); return project(b.c[3 * i], b.c[3 * i + 1], b.c[3 * i + 2]).slice(0, 2); },
    frame: () => { viewer.render(); return true; },
  };
  const shots = parseInt(new URLSearchParams(location.hash.slice(1)).get("shots"), 10);
  if (shots > 0) {                                 // a film for `pinflex view --gif`: the page prints its own pictures
    const a = R.t[0], b = R.t[R.t.length - 1], last = R.mode ? shots : Math.max(shots - 1, 1), pictures = el("pre", {hidden: true, id: "pinflex-shots"});
    for (let i = 0; i < shots; i++) { seek(a + (b - a) * i / last); pictures.append(image() + "\n"); }
    document.body.append(pictures);
  }
  requestAnimationFrame(() => requestAnimationFrame(() => { viewer.render(); place(); window.pinflex.ready = true; announce(); }));
}
start();
