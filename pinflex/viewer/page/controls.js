/* controls.js: what buttons, keys and time change. */
const layoutChanged = () => { viewer.resize(); if (R && !cameraMoved) fitCamera(); };

function set(change) {
  Object.assign(S, change);
  if (R) {
    const has = (...keys) => keys.some((k) => k in change);
    if (S.other === String(S.run)) S.other = "rigid";
    if (has("play")) { last = null; if (S.play && S.t >= R.t[R.t.length - 1]) S.t = R.t[0]; }
    if (has("diff")) S.field = S.diff ? (otherRun() ? "difference" : "displacement") : DATA.field;
    if (has("other") && S.diff) S.field = otherRun() ? "difference" : "displacement";
    if (change.link != null) S.table = false;       // one panel at a time
    else if (change.table) S.link = null;
    if (has("theme")) applyTheme();
    if (has("shadow")) shade();
    if (has("other", "ghost")) chooseGhost();
    setColours();
    if (has("plots", "ui", "other", "diff", "force", "hide", "zoom")) { document.body.classList.toggle("bare", !S.ui); drawPlots(); viewer.resize(); }
    if (has("link", "at", "other", "zoom", "table")) openBeam();
    if (has("table", "link", "other", "diff", "force", "hide", "zoom")) openTable();
    if (has("ghost") && !cameraMoved) fitCamera();
    if (has("mag", "path")) drawPath();
    seek(S.t);
  }
  showControls();
  announce();
}
function showControls() {
  const play = $("play");
  play.textContent = S.play ? "❚❚" : "▶";
  play.setAttribute("aria-label", S.play ? "pause" : "play");
  const possible = {force: scene.forces.length, torque: scene.torques.length, plots: R.plots.length, colours: R.fields.length,
    peak: R.fields.length && !R.mode, names: scene.links.length, loop: true, table: R.plots.length, shadow: true, diff: !R.mode && (comparable() || R.plots.some((p) => p.curves.some((c) => c.rigid)))};
  for (const [k, has] of Object.entries(possible)) {
    $("opt-" + k).checked = S[k] && !!has;
    $("opt-" + k).disabled = !has;
  }
  for (const k of ["field", "map", "ghost", "speed", "path", "theme", "other"]) if ($(k).value !== String(S[k])) $(k).value = String(S[k]);
  if ($("link").value !== (S.link ?? "")) $("link").value = S.link ?? "";
  $("path").disabled = !scene.path;
  $("ghost").disabled = !comparable();
  $("limit").value = S.limit > 0 ? S.limit : "";
  $("max").value = S.max > 0 ? S.max : "";
  $("max").placeholder = digits(fieldMax());
  const near = scene.steps.reduce((b, v, i) => Math.abs(v - S.mag) < Math.abs(scene.steps[b] - S.mag) ? i : b, 0);
  $("mag").max = scene.steps.length - 1;
  $("mag").value = near;
  $("mag").setAttribute("aria-valuetext", `times ${S.mag}`);
  $("mag-number").value = +S.mag.toPrecision(4);
  $("mag").disabled = $("mag-number").disabled = !scene.moves && !otherRun();
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
function fullScreen() {
  if (document.fullscreenElement) document.exitFullscreen();
  else document.documentElement.requestFullscreen().catch(() => say("this browser does not allow full screen"));
}
function nextLink(n) {
  const names = R.mode ? [] : R.links.map((k) => k.name), i = names.indexOf(S.link);
  if (names.length) set({link: i < 0 ? names[n > 0 ? 0 : names.length - 1] : names[i + n] ?? null, at: null});
}
function escape() {
  const menu = document.querySelector(".menu[open]");
  if (menu) { menu.open = false; menu.firstChild.focus(); } else if (S.link !== null) closeBeam(); else if (S.table) set({table: false});
}
function keys(e) {
  if (e.ctrlKey || e.metaKey || e.altKey) return;
  if (e.key === "Escape") { escape(); return; }
  const typing = e.target.matches("input[type=number], select, textarea"), range = e.target.matches("input[type=range], input[type=radio]");
  const pressable = e.target.matches("button, summary, input[type=checkbox], input[type=radio]");
  if (typing || (e.key === " " && pressable) || (range && /^(Arrow|Home|End)/.test(e.key))) return;
  if (/^[1-9]$/.test(e.key) && DATA.runs.length > 1 && DATA.runs[e.key - 1]) { show(e.key - 1); return; }
  const n = e.shiftKey ? 10 : 1;
  const act = {" ": () => set({play: !S.play}), ArrowRight: () => step(n), ArrowLeft: () => step(-n), Home: () => step(-1e9), End: () => step(1e9),
    "+": () => stepMag(1), "=": () => stepMag(1), "-": () => stepMag(-1), w: worst, n: () => set({names: !S.names}), f: () => set({force: !S.force}),
    l: () => nextLink(1), L: () => nextLink(-1), d: () => set({diff: !S.diff}), t: () => set({table: !S.table}), z: () => zoomBy(0.5), Z: () => set({zoom: null}), g: () => set({ghost: {over: "beside", beside: "off", off: "over"}[S.ghost]})}[e.key];
  if (act) { act(); e.preventDefault(); }
}

let last = null;
function tick(now) {
  requestAnimationFrame(tick);
  viewer.begin(now);
  if (!S.play || !R) { last = null; return; }
  if (last !== null) {
    const a = R.t[0], b = R.t[R.t.length - 1];
    let t = S.t + Math.min(now - last, 250) / 1e3 * S.speed;   // a sleeping tab does not jump
    if (t >= b && !S.loop) { S.play = false; t = b; showControls(); announce(); }
    else if (t > b) t = b > a ? a + ((t - a) % (b - a)) : a;
    seek(t);
    viewer.move();                                 // in this frame
  }
  last = now;
}
