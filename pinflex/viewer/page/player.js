/* player.js: shows a run, and starts the page. */
function show(index, from = {}) {
  const first = R === null, before = R && {t: S.t, mag: S.mag, speed: S.speed, rest: !S.play};
  if (scene) scene.root.visible = false;
  S.run = +index;
  R = DATA.runs[S.run];
  scene = sceneOf(S.run);
  scene.root.visible = true;
  const span = R.t[R.t.length - 1] - R.t[0] || 1, speed = R.mode ? span / 1.6 : nice(span / 6);
  showHead();
  if (![...$("speed").options].some((o) => +o.value === speed)) $("speed").append(el("option", {value: speed}, R.mode ? "1 period in 1.6 s" : "×" + speed));
  const kept = before && !R.mode ? {mag: before.mag, speed: before.speed} : {mag: R.scale, speed};   // pictures that can be compared
  Object.assign(S, kept, {max: first ? null : S.max});
  if (first || R.mode) S.field = R.mode ? "displacement" : DATA.field;
  if (S.other === String(S.run) || (S.other === "rigid" && R.key === "rigid" && DATA.runs.length > 1 && first)) S.other = "rigid";
  if (first) Object.assign(DEFAULT, S, {max: null});
  Object.assign(S, from);
  if (from.diff && !from.field) S.field = otherRun() ? "difference" : "displacement";
  if (S.other === String(S.run)) S.other = "rigid";
  $("other").replaceChildren(el("option", {value: "rigid"}, R.mode ? "at rest" : "rigid pose"), ...DATA.runs.flatMap((r, i) =>
    i === S.run || R.mode || r.key === "rigid" ? [] : [el("option", {value: i}, runLabel(r, i))]));
  $("link").replaceChildren(el("option", {value: ""}, "none (click a link)"), ...R.links.map((k) => el("option", {value: k.name}, k.name)));
  $("link").disabled = !R.links.length || !!R.mode;
  if (!fieldOf(S.field)) S.field = (R.fields.find((f) => f.key === DATA.field) || R.fields[0] || {}).key;
  if (!scene.moves && DATA.runs.length < 2) { S.mag = 1; S.ghost = "off"; }   // nothing to compare with
  document.body.classList.toggle("bare", !S.ui);
  document.body.classList.toggle("rigid", !scene.moves && !otherRun());
  document.body.classList.toggle("mode", !!R.mode);
  document.body.classList.toggle("single", DATA.runs.length < 2 || !!R.mode);
  $("time").min = R.t[0]; $("time").max = R.t[R.t.length - 1];
  scene.factor = 1;
  chooseGhost();
  setColours();
  place3d();
  if (S.link !== null) S.table = false;
  if (S.zoom && !(S.zoom[0] < R.t[R.t.length - 1])) S.zoom = null;   // the other run ended before
  openBeam();
  drawPlots();
  openTable();
  viewer.resize();
  drawPath();
  if (from.cam) {
    cameraMoved = true;
    fitCamera();
    const position = V(...from.cam.slice(0, 3)), target = V(...from.cam.slice(3));
    aim(target, position, position.distanceTo(target));
  } else if (!cameraMoved) fitCamera();
  /* a run opens where it is furthest from rigid, at rest; one that plays begins at the beginning; another level at the same instant */
  const opening = before && !R.mode ? before.t : R.mode ? S.t : from.play ? R.t[0] : R.opens;
  S.t = clamp(from.t ?? opening ?? S.t, R.t[0], R.t[R.t.length - 1]);
  set({play: S.play && !reduced});
}

function showHead() {
  for (const input of document.querySelectorAll("#levels input")) input.checked = +input.value === S.run;
  if ($("run")) $("run").value = S.run;
  const told = R.label && R.label !== R.key ? R.label : R.level;
  $("sub").textContent = R.mode ? `natural frequency ${digits(R.mode.frequency, 4)} Hz` : told;
  showVerdicts();
}
/* Light, ground and notes, which depend on how far the robot reaches. */
function place3d() {
  const {low, extent, centre} = (() => { const g = S.ghost; S.ghost = "over"; const box = boxOf(cloud()); S.ghost = g; return box; })();
  const flat = extent.z < 0.15 * Math.max(extent.x, extent.y), right = V(0, 0, 1).cross((scene.extent = extent, viewFrom(extent))).normalize();
  const across = (() => { const g = S.ghost; S.ghost = "over"; const all = cloud().map((p) => p.dot(right)); S.ghost = g; return all; })();
  scene.aside = right.clone().multiplyScalar(1.12 * (Math.max(...across) - Math.min(...across)));   // seen as large as the robot
  scene.crown = V(centre.x, centre.y, boxOf(cloud()).high.z + 0.03 * scene.size);
  const cell = light(scene.size, centre, low.z - (flat ? 0.05 : 0.12) * scene.size), notes = [...scene.notes, `grid ${digits(1e3 * cell, 3)} mm`];
  if (scene.moves && !R.mode) notes.unshift("deflections are magnified about the rigid pose; ×1 is true, ×0 rigid");
  if (R.links.some((k) => Object.keys(k.sections).length)) notes.push("section forces to 0.01 % of their largest");
  $("notes").textContent = notes.join(" · ");
}

function start() {
  buildPage();
  const wish = (new URLSearchParams(location.hash.slice(1)).get("size") || "").match(/^(\d+)x(\d+)$/);
  if (wish) Object.assign($("app").style, {width: wish[1] + "px", height: wish[2] + "px"});  // a film of that size in any window
  const from = readHash();
  if (from.theme) S.theme = from.theme;
  makeViewer();
  applyTheme();
  if (from.run === undefined && DATA.runs[0].mode && from.play === undefined) from.play = true;
  show(from.run ?? DATA.first, from);
  pressed("fit");
  addEventListener("keydown", keys);
  const stage = $("stage");
  stage.addEventListener("pointermove", hover);
  stage.addEventListener("pointerdown", hover);
  stage.addEventListener("pointerdown", press, true);
  stage.addEventListener("pointerup", release);
  stage.addEventListener("pointerleave", () => { $("tip").hidden = true; });
  addEventListener("hashchange", () => { if (location.hash !== ownHash) { const h = readHash(); if (h.run !== undefined && h.run !== S.run) show(h.run, h); else set(h); } });
  requestAnimationFrame(tick);
  window.pinflex = handle();
  const shots = parseInt(new URLSearchParams(location.hash.slice(1)).get("shots"), 10);
  if (shots > 0) printShots(shots);
  requestAnimationFrame(() => requestAnimationFrame(() => { viewer.render(); place(); window.pinflex.ready = true; announce(); }));
}
function printShots(count) {                       // a film for `pinflex view --gif`: the page prints its own pictures
  const a = R.t[0], b = R.t[R.t.length - 1], last = R.mode ? count : Math.max(count - 1, 1), pictures = el("pre", {hidden: true, id: "pinflex-shots"});
  for (let i = 0; i < count; i++) { seek(a + (b - a) * i / last); pictures.append(image() + "\n"); }
  document.body.append(pictures);
}
/* What a script may ask of the page. */
function handle() {
  const link = (name) => scene.links.find((b) => b.data.name === name);
  return {
    ready: false, seek: (t) => { seek(t); announce(); }, setMag, set, worst, image, show, look, copyLink, saveCurves, saveBeam,
    get state() { return {...S, frames: R.t.length, duration: R.t[R.t.length - 1], name: R.name, steps: scene.steps.slice()}; },
    get legend() { return {min: scene.signed ? -legendMax() : 0, max: legendMax(), unit: fieldOf(S.field)?.unit, field: S.field}; },
    get links() { return scene.links.map((b) => b.data.name); },
    get beam() { return beam && {name: beam.k.name, x: beam.x, station: beam.station, quantities: beam.list.map((q) => q.key), rows: beamRows()}; },
    get curves() { return curveRows(); },
    centreline: (name) => Array.from(link(name).c),
    ghostline: (name) => Array.from(ghost.links.find((b) => b.data.name === name).c),
    surface: (name) => Array.from(link(name).sweep.position),
    values: (name) => Array.from(link(name).now, (v) => v * scene.factor),
    describe: (name, i) => describe(link(name), i, 0),
    point: (body, i) => { const b = scene.bodies.find((x) => x.data.name === body); return V(...b.data.points[i]).applyMatrix4(b.matrix).toArray(); },
    pixel: (name, i) => { const b = link(name); return project(b.c[3 * i], b.c[3 * i + 1], b.c[3 * i + 2]).slice(0, 2); },
    get stems() { return scene.robot.stems.map((s) => Array.from(s.c)); },
    frame: () => { viewer.render(); return true; },
    get sharpness() { return {ratios: viewer.ratios, level: viewer.level, now: viewer.renderer.getPixelRatio()}; },
  };
}
start();
