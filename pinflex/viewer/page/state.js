/* state.js: what is shown, its text form in the address, and small helpers.

The files of this folder run as one script, in the order of view.PLAYER, inside one function. */
THREE.ColorManagement.enabled = false;             // colours are drawn as they are written here
const MAPS = {                                     // viridis and cividis read the same to colour-blind eyes
  viridis: "44015448186a472d7b4240863b528b33638d2c728e26828e21918c1fa08828ae803fbc735ec96284d44baddc30d8e219fde725",
  cividis: "00224e002e6a1a386f32436d434e6c535a6d61656f6f70737d7c788c88789b9476aba072bcae6ccdbb63dec958f0d846fee838",
  turbo: "30123b4040a2466be34294ff28bceb18ddc232f2986dfe62a4fc3ccdec34eecf3afdac34fb7e21eb500ed02f05a916017a0403",
  signed: "3b4cc04e68d86282ea779af78db0fea3c2feb9d0f9ccd9eddddcdcecd3c5f5c4acf7b093f4987aeb7d62dd5f4bca3b37b40426",
};
const OVER = [204, 0, 102];                        // above the limit: in none of the maps
const COLOUR = {body: 0x758297, platform: 0x56637a, joint: 0x525e70, base: 0x9aa5b5, ghost: 0x7b8798, other: 0xe69f00,
                plain: 0x8795a8};
const reduced = matchMedia("(prefers-reduced-motion: reduce)").matches;

/* ---------------------------------------------------------------- small helpers */
const $ = (id) => document.getElementById(id);
const clamp = (x, a, b) => Math.min(b, Math.max(a, x));
const digits = (x, n = 3) => {                     // 3 significant digits, no exponent where avoidable
  if (!isFinite(x)) return "–";
  if (x === 0) return "0";
  const a = Math.abs(x);
  if (a >= 1e5 || a < 1e-3) return x.toExponential(n - 1).replace("e+", "e");
  return x.toFixed(clamp(n - 1 - Math.floor(Math.log10(a) + 1e-9), 0, 6));
};
const minus = (text) => String(text).replace("-", "−");
const nice = (x, up) => {                          // nearest 1, 2, 5 times a power of ten
  const p = 10 ** Math.floor(Math.log10(x)), r = x / p;
  const s = up ? [1, 2, 5, 10].find((v) => v >= r - 1e-9) : [1, 2, 5, 10].reduce((a, b) =>
    Math.abs(Math.log(b / r)) < Math.abs(Math.log(a / r)) ? b : a);
  return +(s * p).toPrecision(2);
};
const SVG = ["svg", "path", "line", "text", "g", "rect", "circle"];
function el(tag, attributes, ...children) {        // texts become text nodes: names cannot be markup
  const e = SVG.includes(tag) ? document.createElementNS("http://www.w3.org/2000/svg", tag) : document.createElement(tag);
  for (const [k, v] of Object.entries(attributes || {})) {
    if (k.startsWith("on")) e.addEventListener(k.slice(2), v);
    else if (v === true) e.setAttribute(k, "");
    else if (v !== false && v != null) e.setAttribute(k, v);
  }
  e.append(...children.filter((c) => c != null));
  return e;
}
const maxAbs = (a) => { let m = 0; for (const x of a) if (Math.abs(x) > m) m = Math.abs(x); return m; };
const say = (text) => { $("status").textContent = text; };   // to a screen reader

/* ---------------------------------------------------------------- state and its text form */
const S = {run: 0, other: "rigid", diff: false, t: 0, mag: 1, field: "von_mises", map: "viridis", max: null, limit: DATA.limit,
           play: false, speed: 1, loop: true, colours: true, ghost: "over", path: "true", force: false, torque: false, names: false,
           peak: true, plots: true, ui: true, link: null, at: null, theme: "auto",
           table: false, hide: [], zoom: null, shadow: true};
const DEFAULT = {};
let R = null, scene = null;                        // the run shown and its drawn objects
const KEYS = {other: "text", diff: "flag", colours: "flag", path: "text", force: "flag", torque: "flag", names: "flag", peak: "flag",
              plots: "flag", loop: "flag", ui: "flag", play: "flag", ghost: "text", field: "text", map: "text", max: "number",
              limit: "number", speed: "number", mag: "number", t: "number", link: "text", at: "number", theme: "text",
              table: "flag", hide: "names", zoom: "span", shadow: "flag"};
const WORDS = {ghost: ["off", "over", "beside"], map: ["viridis", "cividis", "turbo"], path: ["true", "magnified", "off"], theme: ["auto", "light", "dark"]};

function readHash() {
  const h = new URLSearchParams(location.hash.slice(1)), out = {};
  for (const [k, kind] of Object.entries(KEYS)) {
    if (!h.has(k)) continue;
    const v = h.get(k), x = parseFloat(v);
    if (kind === "flag") out[k] = v === "1";
    else if (kind === "number") { if (isFinite(x)) out[k] = x; }
    else if (kind === "names") out[k] = v.split("|").filter(Boolean);
    else if (kind === "span") { const ends = v.split(",").map(Number); if (ends.length === 2 && ends.every(isFinite) && ends[0] < ends[1]) out[k] = ends; }
    else out[k] = v;
  }
  if (out.path === "0" || out.path === "1") out.path = out.path === "1" ? "true" : "off";
  for (const [k, words] of Object.entries(WORDS)) if (out[k] && !words.includes(out[k])) delete out[k];
  if (h.has("run")) out.run = clamp(parseInt(h.get("run"), 10) || 0, 0, DATA.runs.length - 1);
  if (out.other && out.other !== "rigid" && !DATA.runs[out.other]) delete out.other;
  const cam = (h.get("cam") || "").split(",").map(Number);
  if (cam.length === 6 && cam.every(isFinite)) out.cam = cam;
  return out;
}
let hashTimer = null, ownHash = "", cameraMoved = false;
function hashText() {
  const h = new URLSearchParams();
  if (DATA.runs.length > 1) h.set("run", S.run);
  for (const k of ["t", "mag"]) h.set(k, +S[k].toPrecision(6));
  if (S.field) h.set("field", S.field);
  for (const [k, kind] of Object.entries(KEYS)) {
    if (["t", "mag", "field", "play"].includes(k) || String(S[k]) === String(DEFAULT[k]) || S[k] == null) continue;
    h.set(k, kind === "flag" ? +S[k] : kind === "names" ? S[k].join("|") : S[k]);
  }
  if (cameraMoved) {
    const p = viewer.camera.position, q = viewer.controls.target;
    h.set("cam", [p.x, p.y, p.z, q.x, q.y, q.z].map((x) => +x.toPrecision(4)).join(","));
  }
  return "#" + String(h).replaceAll("%2C", ",");
}
function writeHash() {                             // at most four times a second, never while playing
  if (hashTimer || S.play) return;
  hashTimer = setTimeout(() => { hashTimer = null; if (!S.play) keepHash(); }, 250);
}
function keepHash() {
  ownHash = hashText();
  try { history.replaceState(null, "", ownHash); } catch (e) { /* an inlined page has no address */ }
}
