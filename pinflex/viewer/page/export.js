/* export.js: pictures, films, tables and links to take away. */
/* The drawing with its texts on a canvas of its own, s pixels a pixel of the page. */
function compose(c, s = viewer.ratios[0]) {
  const from = viewer.renderer.domElement, g = c.getContext("2d"), ink = style("--ink");
  c.width = Math.floor(s * from.clientWidth); c.height = Math.floor(s * from.clientHeight);
  g.drawImage(from, 0, 0, c.width, c.height);
  g.scale(s, s);
  const text = (font, words, x, y) => { g.font = `${font} system-ui, sans-serif`; g.fillText(words, x, y); };
  g.fillStyle = ink;
  text("600 16px", DATA.title, 20, 32);
  const verdicts = R.verdicts.filter((v) => v.kind !== "plain").map((v) => v.text), level = DATA.runs.length > 1 ? [runLabel(R, S.run)] : [];
  text("13px", [...level, ...[...$("readout").children].map((e) => e.textContent)].join("  ·  "), 20, 52);
  if (verdicts.length) text("13px", "⚠ " + verdicts.join("; ").slice(0, 120), 20, 70);
  const f = fieldOf(S.field);
  if (f && S.colours) {
    const top = legendMax(), low = scene.signed ? -top : 0;
    text("13px", `${f.label} ${R.mode ? "(relative)" : `[${f.unit}]`}`, 20, 94);
    for (let i = 0; i < 180; i++) { g.fillStyle = `rgb(${colourOf(top + (low - top) * i / 179)})`; g.fillRect(20, 104 + i, 16, 1.5); }
    g.fillStyle = ink;
    for (const [v, words] of legendTicks()) text("13px", words, 42, 108 + 180 * (top - v) / (top - low));
  }
  for (const m of marks) if (!m.hidden) {
    const [, x, y] = m.style.transform.match(/([\d.-]+)px, ([\d.-]+)px/);
    text("600 13px", m.textContent, +x + 10, +y - 8);
    if (m.classList.contains("peak")) ring(g, +x, +y);
  }
  return c;
}
function ring(g, x, y) {
  for (const [width, colour] of [[5, style("--halo")], [2, style("--ink")]]) { g.lineWidth = width; g.strokeStyle = colour; g.beginPath(); g.arc(x, y, 5, 0, 2 * Math.PI); g.stroke(); }
  g.fillStyle = style("--ink");
}
function image() { viewer.render(); place(); return compose(document.createElement("canvas")).toDataURL("image/png"); }
function save(name, url) { el("a", {href: url, download: name}).click(); }
function saveFile(name, blob) {
  const url = URL.createObjectURL(blob);
  save(name, url);
  setTimeout(() => URL.revokeObjectURL(url), 1e4);
  say(`${name} saved`);
}
function saveText(name, rows) {
  const quoted = (v) => typeof v === "number" ? (isFinite(v) ? String(+v.toPrecision(7)) : "") : /[",\n]|^[=+\-@]/.test(v) ? `"${v.replaceAll('"', '""')}"` : v;
  const text = rows.map((r) => r.map(quoted).join(",")).join("\n") + "\n";
  saveFile(name, new Blob([text], {type: "text/csv"}));
  return text;
}
const fileName = (...parts) => [DATA.file, ...parts].filter(Boolean).map((p) => p.replace(/[^A-Za-z0-9._-]+/g, "-")).join("-");
const levelName = () => DATA.runs.length > 1 ? runLabel(R, S.run) : "";
function savePicture() { save(`${fileName(levelName())}.png`, image()); }

/* All plots over time: one row an instant, one column a curve. */
function curveRows() {
  const columns = plotList().flatMap((p) => p.curves.map((c) => [`${p.title} ${c.name}${c.rigid ? ` (${otherName()})` : ""} [${p.unit}]`, c.y]));
  return [["t [s]", ...columns.map((c) => c[0])], ...R.t.map((t, i) => [t, ...columns.map((c) => c[1][i])])];
}
function saveCurves() { return saveText(`${fileName(levelName(), "curves")}.csv`, curveRows()); }
/* One link: first along x at this instant, then over time at the place chosen. */
function beamRows() {
  const at = instant(S.t), values = beam.list.map((q) => along(q, at, new Float32Array(q.m))), heads = beam.list.map((q) => `${q.title} [${q.unit}]`);
  const over = beam.list.map((q) => overTime(q, beam.station));
  return [[`link ${beam.k.name}, along x at t = ${S.t.toPrecision(6)} s`], ["x [mm]", ...heads], ...beam.x.map((x, i) => [x, ...values.map((v) => v[i])]), [""],
    [`over time at x = ${digits(beam.x[beam.station], 5)} mm`], ["t [s]", ...heads], ...R.t.map((t, i) => [t, ...over.map((v) => v[i])])];
}
function saveBeam() { return saveText(`${fileName(levelName(), beam.k.name)}.csv`, beamRows()); }

async function copyLink() {
  keepHash();
  const link = location.href.split("#")[0] + ownHash, done = (yes) => {
    say(yes ? "link copied" : "copy the address of the page");
    $("copy").textContent = yes ? "Copied ✓" : "See the address bar";
    setTimeout(() => { $("copy").textContent = "Copy link"; }, 2000);
  };
  try { await navigator.clipboard.writeText(link); done(true); } catch (e) { done(copyOld(link)); }
  return link;
}
function copyOld(text) {                           // where a page from a file may not use the clipboard
  const area = el("textarea", {class: "unseen", "aria-hidden": "true"});
  area.value = text;
  document.body.append(area);
  area.select();
  let yes = false;
  try { yes = document.execCommand("copy"); } catch (e) { yes = false; }
  area.remove();
  return yes;
}
function film() {
  const canvas = document.createElement("canvas"), sharp = Math.min(devicePixelRatio, viewer.ratios[0]);
  if (!canvas.captureStream || !window.MediaRecorder) { say("this browser cannot record"); return; }
  compose(canvas, sharp);
  const parts = [], recorder = new MediaRecorder(canvas.captureStream(30)), loop = S.loop;
  recorder.ondataavailable = (e) => parts.push(e.data);
  recorder.onstop = () => {
    const kind = /mp4/.test(recorder.mimeType) ? "mp4" : "webm";   // as the browser has it
    saveFile(`${fileName(levelName())}.${kind}`, new Blob(parts, {type: recorder.mimeType}));
    $("film").classList.remove("on");
  };
  $("film").classList.add("on");
  const draw = () => {
    viewer.render();
    compose(canvas, sharp);
    if (S.play) requestAnimationFrame(draw);
    else { viewer.recording = false; set({loop}); setTimeout(() => recorder.stop(), 300); }   // [ms] the last picture stays for a moment
  };
  recorder.onstart = () => { viewer.recording = true; seek(R.t[0]); set({loop: false, play: true}); draw(); };
  recorder.start();
}
