/* state.js: what is shown, its text form in the address, and the page it is shown on.

The files of this folder run as one script, in the order of view.PLAYER, inside one function. */
const THREE = MeshCat.THREE;
const MAPS = {                                     // viridis and cividis read the same to colour-blind eyes
  viridis: "44015448186a472d7b4240863b528b33638d2c728e26828e21918c1fa08828ae803fbc735ec96284d44baddc30d8e219fde725",
  cividis: "00224e002e6a1a386f32436d434e6c535a6d61656f6f70737d7c788c88789b9476aba072bcae6ccdbb63dec958f0d846fee838",
  turbo: "30123b4040a2466be34294ff28bceb18ddc232f2986dfe62a4fc3ccdec34eecf3afdac34fb7e21eb500ed02f05a916017a0403",
  signed: "3b4cc04e68d86282ea779af78db0fea3c2feb9d0f9ccd9eddddcdcecd3c5f5c4acf7b093f4987aeb7d62dd5f4bca3b37b40426",
};
const OVER = [204, 0, 102];                        // above the limit: in none of the maps
const CURVES = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#7a6a00", "#56b4e9", "#444b57", "#e69f00"];
const COLOUR = {body: 0x758297, platform: 0x56637a, joint: 0x525e70, base: 0x9aa5b5, ghost: 0x7b8798,
                path: 0xd55e00, pathRigid: 0x9aa3b0, force: 0x0072b2, torque: 0xb0418a, plain: 0x8795a8};
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
function el(tag, attributes, ...children) {        // texts become text nodes: names cannot be markup
  const svg = ["svg", "path", "line", "text", "g", "rect", "circle"].includes(tag);
  const e = svg ? document.createElementNS("http://www.w3.org/2000/svg", tag) : document.createElement(tag);
  for (const [k, v] of Object.entries(attributes || {})) {
    if (k.startsWith("on")) e.addEventListener(k.slice(2), v);
    else if (v === true) e.setAttribute(k, "");
    else if (v !== false && v != null) e.setAttribute(k, v);
  }
  e.append(...children.filter((c) => c != null));
  return e;
}
const maxAbs = (a) => { let m = 0; for (const x of a) if (Math.abs(x) > m) m = Math.abs(x); return m; };

/* ---------------------------------------------------------------- state and its text form */
const S = {run: 0, t: 0, mag: 1, field: "von_mises", map: "viridis", max: null, limit: DATA.limit, play: false,
           speed: 1, loop: true, colours: true, ghost: "over", path: true, force: false, torque: false, names: false,
           peak: true, plots: true, ui: true};
const DEFAULT = {};
let R = null, scene = null;                        // the run shown and its drawn objects
const KEYS = {colours: "flag", path: "flag", force: "flag", torque: "flag", names: "flag", peak: "flag", plots: "flag",
              loop: "flag", ui: "flag", play: "flag", ghost: "text", field: "text", map: "text", max: "number",
              limit: "number", speed: "number", mag: "number", t: "number"};

function readHash() {
  const h = new URLSearchParams(location.hash.slice(1)), out = {};
  for (const [k, kind] of Object.entries(KEYS)) {
    if (!h.has(k)) continue;
    const v = h.get(k), x = parseFloat(v);
    if (kind === "flag") out[k] = v === "1";
    else if (kind === "number") { if (isFinite(x)) out[k] = x; }
    else out[k] = v;
  }
  if (out.ghost && !["off", "over", "beside"].includes(out.ghost)) delete out.ghost;
  if (out.map && !["viridis", "cividis", "turbo"].includes(out.map)) delete out.map;
  if (h.has("run")) out.run = clamp(parseInt(h.get("run"), 10) || 0, 0, DATA.runs.length - 1);
  const cam = (h.get("cam") || "").split(",").map(Number);
  if (cam.length === 6 && cam.every(isFinite)) out.cam = cam;
  return out;
}
let hashTimer = null, ownHash = "", cameraMoved = false;
function writeHash() {                             // at most four times a second, never while playing
  if (hashTimer || S.play) return;
  hashTimer = setTimeout(() => {
    hashTimer = null;
    if (S.play) return;
    const parts = [`t=${+S.t.toPrecision(6)}`, `mag=${+S.mag.toPrecision(6)}`, `field=${S.field}`];
    if (DATA.runs.length > 1) parts.unshift(`run=${S.run}`);
    for (const [k, kind] of Object.entries(KEYS)) {
      if (["t", "mag", "field", "play"].includes(k) || S[k] === DEFAULT[k] || S[k] == null) continue;
      parts.push(`${k}=${kind === "flag" ? +S[k] : S[k]}`);
    }
    if (cameraMoved) {
      const p = viewer.camera.position, q = viewer.controls.target;
      parts.push("cam=" + [p.x, p.y, p.z, q.x, q.y, q.z].map((x) => +x.toPrecision(4)).join(","));
    }
    ownHash = "#" + parts.join("&");
    try { history.replaceState(null, "", ownHash); } catch (e) { /* an inlined page has no address */ }
  }, 250);
}

/* ---------------------------------------------------------------- the page */
const check = (key, text, label) => el("label", {class: "check", title: label || text},
  el("input", {type: "checkbox", id: "opt-" + key, onchange: (e) => set({[key]: e.target.checked})}), text);
const select = (id, label, options, onchange) => el("select", {id, "aria-label": label, onchange},
  ...options.map(([v, text]) => el("option", {value: v}, text)));

function buildPage() {
  const speeds = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5];
  $("app").append(
    el("main", {id: "stage"},
      el("div", {id: "meshcat-pane", role: "img", tabindex: "0", "aria-describedby": "status"}),
      el("div", {id: "labels", "aria-hidden": "true"}),
      el("header", {id: "head"},
        el("h1", {}, DATA.title),
        el("div", {id: "sub"}),
        DATA.runs.length > 1 ? el("select", {id: "run", "aria-label": "run",
          onchange: (e) => show(+e.target.value)}, ...DATA.runs.map((r, i) => el("option", {value: i}, runLabel(r, i)))) : null,
        el("div", {id: "readout"}),
        el("div", {id: "remark"})),
      el("section", {id: "legend", "aria-label": "colour legend"},
        el("div", {id: "legend-title"},
          select("field", "coloured by", [], (e) => set({field: e.target.value, max: null})), el("span", {id: "unit"})),
        el("div", {id: "scale"}, el("div", {id: "bar"}), el("div", {id: "ticks"})),
        el("div", {id: "keys"})),
      el("details", {id: "options"},
        el("summary", {title: "display options"}, "Display"),
        el("div", {class: "grid"},
          el("label", {class: "wide"}, "rigid pose ",
            select("ghost", "rigid pose", [["over", "overlaid"], ["beside", "side by side"], ["off", "hidden"]],
              (e) => set({ghost: e.target.value}))),
          check("colours", "colours"), check("peak", "peak marker"), check("path", "path"), check("names", "link names"),
          check("force", "joint forces"), check("torque", "motor torques"), check("plots", "plots"), check("loop", "loop"),
          el("label", {class: "wide"}, "colour map ", select("map", "colour map", [["viridis", "viridis"], ["cividis", "cividis"], ["turbo", "turbo"]],
            (e) => set({map: e.target.value}))),
          el("label", {class: "wide"}, "maximum ", el("input", {id: "max", type: "number", step: "any", min: "0",
            onchange: (e) => set({max: parseFloat(e.target.value) > 0 ? parseFloat(e.target.value) : null})}),
            el("button", {type: "button", title: "largest value of the run", onclick: () => set({max: null})}, "auto")),
          el("label", {class: "wide", title: "material limit: above it the colour changes"}, "limit ",
            el("input", {id: "limit", type: "number", step: "any", min: "0", placeholder: "none",
              onchange: (e) => set({limit: parseFloat(e.target.value) > 0 ? parseFloat(e.target.value) : null})})),
          el("div", {class: "wide buttons"},
            el("button", {type: "button", onclick: () => { cameraMoved = false; fitCamera(); writeHash(); }}, "reset view"),
            el("button", {type: "button", onclick: savePicture, title: "picture of this instant, with its legend"}, "picture"),
            el("button", {type: "button", id: "film", onclick: film, title: "record one pass as a film"}, "film"),
            el("button", {type: "button", onclick: () => document.body.classList.toggle("tree"), title: "meshcat scene tree"}, "tree"))),
        el("p", {id: "notes"}),
        el("p", {class: "help"}, "space play · ← → frame (shift: 10) · home end · + − magnify · w worst · g rigid · n names · f forces")),
      el("div", {id: "tip", role: "tooltip", hidden: true})),
    el("footer", {id: "dock"},
      el("div", {id: "controls"},
        el("button", {id: "play", type: "button", "aria-label": "play", onclick: () => set({play: !S.play})}),
        el("input", {id: "time", type: "range", min: 0, max: 1, step: "any", "aria-label": "time", oninput: (e) => seek(+e.target.value)}),
        el("output", {id: "clock", for: "time"}),
        el("label", {id: "speed-box"}, el("span", {}, "speed "), select("speed", "speed, relative to real time",
          speeds.map((s) => [s, "×" + s]), (e) => set({speed: +e.target.value}))),
        el("label", {id: "mag-box"}, el("span", {}, "deflection "),
          el("input", {id: "mag", type: "range", min: 0, step: 1, "aria-label": "magnification of deflections",
            oninput: (e) => setMag(scene.steps[+e.target.value])}),
          el("span", {class: "times"}, "×"),
          el("input", {id: "mag-number", type: "number", min: 0, step: "any", "aria-label": "magnification",
            onchange: (e) => setMag(Math.max(0, parseFloat(e.target.value) || 0))})),
        el("button", {id: "worst", type: "button", title: "go to the largest value of the run", onclick: worst}, "worst", el("span", {}, " instant"))),
      el("div", {id: "plots"})),
    el("div", {id: "status", class: "unseen", role: "status", "aria-live": "polite"}));
}
const runLabel = (r, i) => r.mode ? `mode ${i + 1} · ${digits(r.mode.frequency, 4)} Hz` : `${r.name}, ${r.level}`;

