/* The player of a pinflex page. It re-sweeps every flexible link in the browser, frame by frame.

Every material point is drawn at r_rigid + mag (r - r_rigid), in world coordinates. Bodies follow
the same rule, so their drawn motion is the affine map R_rigid + mag (R - R_rigid), and a point
that two bodies share stays shared: joints do not open at any magnification. */
"use strict";
(() => {
const DATA = JSON.parse(document.getElementById("pinflex-data").textContent, (key, v) => {
  if (!v || typeof v !== "object" || !(v.f4 || v.i2)) return v;
  const bytes = Uint8Array.from(atob(v.f4 || v.i2), (c) => c.charCodeAt(0)).buffer;
  const a = v.f4 ? new Float32Array(bytes) : Float32Array.from(new Int16Array(bytes), (x) => x / 32767);
  a.shape = v.shape;
  return a;
});
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
        el("div", {id: "readout"})),
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

/* ---------------------------------------------------------------- geometry */
const V = (x, y, z) => new THREE.Vector3(x, y, z);
const phong = (color, more) => new THREE.MeshPhongMaterial({color, shininess: 28, specular: 0x1c1c1c, fog: false, ...more});

/* A profile carried along a polyline; `set` moves it. Corners of the profile stay sharp. */
class Sweep {
  constructor(outline, count, material) {
    let area = 0;
    const n = outline.length, o = outline.map((p) => p.slice());
    for (let i = 0; i < n; i++) { const a = o[i], b = o[(i + 1) % n]; area += a[0] * b[1] - a[1] * b[0]; }
    if (area < 0) o.reverse();
    const face = o.map((a, i) => { const b = o[(i + 1) % n], y = b[1] - a[1], z = a[0] - b[0], l = Math.hypot(y, z) || 1; return [y / l, z / l]; });
    const soft = (i) => { const a = face[(i + n - 1) % n], b = face[i]; return a[0] * b[0] + a[1] * b[1] > 0.8; };
    const blend = (i) => { const a = face[(i + n - 1) % n], b = face[i], y = a[0] + b[0], z = a[1] + b[1], l = Math.hypot(y, z) || 1; return [y / l, z / l]; };
    this.ring = [];                                 // [y, z, normal y, normal z], two per edge
    for (let i = 0; i < n; i++) for (const j of [i, (i + 1) % n]) this.ring.push([...o[j], ...(soft(j) ? blend(j) : face[i])]);
    this.outline = o; this.count = count; this.P = 2 * n;
    const total = count * this.P + 2 * n, index = [];
    for (let i = 0; i + 1 < count; i++) for (let e = 0; e < n; e++) {
      const a = i * this.P + 2 * e, b = a + 1, c = b + this.P, d = a + this.P;
      index.push(a, b, c, a, c, d);
    }
    const caps = THREE.ShapeUtils.triangulateShape(o.map((p) => new THREE.Vector2(p[0], p[1])), []);
    const first = count * this.P, last = first + n;
    for (const [a, b, c] of caps) index.push(first + a, first + c, first + b, last + a, last + b, last + c);
    const g = this.geometry = new THREE.BufferGeometry();
    g.setIndex(index);
    for (const [k, m] of [["position", 3], ["normal", 3], ["uv", 2]]) {
      this[k] = new Float32Array(total * m);
      g.setAttribute(k, new THREE.BufferAttribute(this[k], m));
    }
    this.mesh = new THREE.Mesh(g, material);
    this.mesh.frustumCulled = false;                // its bounding sphere is never refreshed
    this.mesh.castShadow = this.mesh.receiveShadow = true;
  }
  /* c: points (3 m); ys: wished y directions (3 m, or 3 for all); values: m texture coordinates */
  set(c, ys, values) {
    const {ring, P, count, position, normal, uv, outline} = this, one = ys.length === 3;
    let o = 0, u = 0, tx = 1, ty = 0, tz = 0;
    for (let i = 0; i < count; i++) {
      const p = 3 * Math.max(i - 1, 0), q = 3 * Math.min(i + 1, count - 1);
      let ax = c[q] - c[p], ay = c[q + 1] - c[p + 1], az = c[q + 2] - c[p + 2];
      const l = Math.hypot(ax, ay, az);
      if (l > 1e-12) { tx = ax / l; ty = ay / l; tz = az / l; }
      const s = one ? 0 : 3 * i;
      let yx = ys[s], yy = ys[s + 1], yz = ys[s + 2];
      const d = yx * tx + yy * ty + yz * tz;
      yx -= d * tx; yy -= d * ty; yz -= d * tz;
      const m = Math.hypot(yx, yy, yz) || 1; yx /= m; yy /= m; yz /= m;
      const zx = ty * yz - tz * yy, zy = tz * yx - tx * yz, zz = tx * yy - ty * yx;
      const cx = c[3 * i], cy = c[3 * i + 1], cz = c[3 * i + 2], v = values ? values[i] : 0;
      for (let j = 0; j < P; j++) {
        const r = ring[j];
        position[o] = cx + r[0] * yx + r[1] * zx; normal[o++] = r[2] * yx + r[3] * zx;
        position[o] = cy + r[0] * yy + r[1] * zy; normal[o++] = r[2] * yy + r[3] * zy;
        position[o] = cz + r[0] * yz + r[1] * zz; normal[o++] = r[2] * yz + r[3] * zz;
        uv[u++] = v; uv[u++] = 0.5;
      }
      if (i === 0 || i === count - 1) {
        let k = 3 * (count * P + (i ? outline.length : 0)), w = k / 3 * 2;
        const sign = i ? 1 : -1;
        for (const r of outline) {
          position[k] = cx + r[0] * yx + r[1] * zx; normal[k++] = sign * tx;
          position[k] = cy + r[0] * yy + r[1] * zy; normal[k++] = sign * ty;
          position[k] = cz + r[0] * yz + r[1] * zz; normal[k++] = sign * tz;
          uv[w++] = v; uv[w++] = 0.5;
        }
      }
    }
    for (const k of ["position", "normal", "uv"]) this.geometry.attributes[k].needsUpdate = true;
  }
}
const circle = (r, n) => Array.from({length: n}, (_, i) => [r * Math.cos(2 * Math.PI * i / n), r * Math.sin(2 * Math.PI * i / n)]);

/* Directions across a polyline that turn as little as possible, for round sweeps. */
function across(c) {
  const n = c.length / 3, out = new Float32Array(c.length);
  const y = V(0, 0, 1), t = V(1, 0, 0), d = V();
  for (let i = 0; i < n; i++) {
    const p = 3 * Math.max(i - 1, 0), q = 3 * Math.min(i + 1, n - 1);
    d.set(c[q] - c[p], c[q + 1] - c[p + 1], c[q + 2] - c[p + 2]);
    if (d.lengthSq() > 1e-24) t.copy(d).normalize();
    y.addScaledVector(t, -y.dot(t));
    if (y.lengthSq() < 1e-6) { y.set(Math.abs(t.x) < 0.7 ? 1 : 0, Math.abs(t.x) < 0.7 ? 0 : 1, 0); y.addScaledVector(t, -y.dot(t)); }
    y.normalize();
    out[3 * i] = y.x; out[3 * i + 1] = y.y; out[3 * i + 2] = y.z;
  }
  return out;
}

function rod(a, b, radius, material) {
  const p = V(...a), d = V(...b).sub(p), mesh = new THREE.Mesh(new THREE.CylinderGeometry(radius, radius, d.length(), 20), material);
  mesh.position.copy(p).addScaledVector(d, 0.5);
  mesh.quaternion.setFromUnitVectors(V(0, 1, 0), d.normalize());
  return mesh;
}

function plate(outline, normal, thickness, material) {
  const n = outline.length, N = V(...normal).normalize(), at = outline.map((p) => V(...p)), mid = V(0, 0, 0);
  at.forEach((p) => mid.addScaledVector(p, 1 / n));
  const position = [], put = (...points) => points.forEach((p) => position.push(p.x, p.y, p.z));
  const top = (p) => p.clone().addScaledVector(N, thickness / 2), low = (p) => p.clone().addScaledVector(N, -thickness / 2);
  const turn = V().subVectors(at[1], at[0]).cross(V().subVectors(mid, at[0])).dot(N) > 0;
  for (let i = 0; i < n; i++) {
    const a = at[turn ? i : (i + 1) % n], b = at[turn ? (i + 1) % n : i];
    put(top(mid), top(a), top(b), low(mid), low(b), low(a), low(a), low(b), top(b), low(a), top(b), top(a));
  }
  const g = new THREE.BufferGeometry();
  g.setAttribute("position", new THREE.Float32BufferAttribute(position, 3));
  g.computeVertexNormals();                        // no shared corners: the edges stay sharp
  return new THREE.Mesh(g, material);
}

/* ---------------------------------------------------------------- one run as drawn objects */
function makeScene(run) {
  const size = run.size, nt = run.t.length, root = new THREE.Group(), soft = new THREE.Group();
  const s = {size, nt, root, soft, links: [], bodies: [], balls: [], besides: [], peaks: {}, notes: run.notes.slice()};
  const ghost = phong(COLOUR.ghost, {blending: THREE.CustomBlending, blendSrcAlpha: THREE.OneFactor, blendDstAlpha: THREE.OneMinusSrcAlphaFactor, opacity: 0.2, depthWrite: false});
  s.ghostMaterial = ghost;
  s.lut = new THREE.DataTexture(new Uint8Array(4 * 1024), 1024, 1, THREE.RGBAFormat);
  s.lut.magFilter = s.lut.minFilter = THREE.LinearFilter;
  const coloured = phong(0xffffff, {map: s.lut, emissive: 0xffffff, emissiveMap: s.lut, emissiveIntensity: 0.16}), plain = phong(COLOUR.plain);
  const least = 0.008 * size;
  let thin = null;
  for (const k of run.links) {
    const m = k.x.length, straight = k.rigid.shape[1] === 2;
    const extent = [0, 1].map((a) => Math.max(...k.outline.map((p) => p[a])) - Math.min(...k.outline.map((p) => p[a])));
    const grow = extent.map((e) => Math.max(1, least / Math.max(e, 1e-9)));
    if (Math.max(...grow) > 1.001) thin = Math.min(thin ?? Infinity, ...extent);
    const outline = k.outline.map((p) => [p[0] * grow[0], p[1] * grow[1]]);
    const sweep = new Sweep(outline, m, coloured), shade = new Sweep(outline, straight ? 2 : m, ghost);
    shade.mesh.castShadow = shade.mesh.receiveShadow = false;
    shade.mesh.renderOrder = -1;                    // before the robot, which then covers it: no tint on the colours
    root.add(sweep.mesh); soft.add(shade.mesh);
    const move = new Float32Array(nt * m);          // size of the displacement, a field as any other
    for (let i = 0; i < nt * m; i++) move[i] = Math.hypot(k.disp[3 * i], k.disp[3 * i + 1], k.disp[3 * i + 2]);
    s.links.push({data: k, m, straight, sweep, shade, coloured, plain, share: Array.from(k.x, (x) => (x - k.x[0]) / (k.x[m - 1] - k.x[0])),
      fields: {...k.fields, displacement: move}, c: new Float32Array(3 * m), r: new Float32Array(3 * m),
      rigid: new Float32Array(straight ? 6 : 3 * m), y: new Float32Array(3 * m), value: new Float32Array(m), now: new Float32Array(m),
      half: Math.max(...outline.map((p) => Math.hypot(...p)))});
  }
  if (thin !== null) s.notes.push(`thin sections are drawn at least ${digits(1e3 * least, 2)} mm thick (true ${digits(1e3 * thin, 2)} mm)`);
  const ballGeometry = new THREE.SphereGeometry(1, 20, 14), jointMaterial = phong(COLOUR.joint);
  const place0 = (b, p) => { const m = b.pose; return V(...[0, 4, 8].map((r) => m[r] * p[0] + m[r + 1] * p[1] + m[r + 2] * p[2] + m[r + 3])); };
  const corners = run.bodies.filter((b) => b.points.length > 1 || b.base).flatMap((b) => b.points.map((p) => place0(b, p)));
  const ends = run.links.flatMap((k) => { const n = 3 * (k.x.length - 1), r = k.rigid, q = 3 * (r.shape[1] - 1);
    return [V(r[0] + k.disp[0], r[1] + k.disp[1], r[2] + k.disp[2]), V(r[q] + k.disp[n], r[q + 1] + k.disp[n + 1], r[q + 2] + k.disp[n + 2])]; });
  const meeting = (at) => corners.concat(ends).some((p) => p.distanceTo(at) < 0.01 * size);
  for (const b of run.bodies) {
    const material = phong(b.base ? COLOUR.base : b.platform ? COLOUR.platform : COLOUR.body);
    const group = new THREE.Group(), shade = b.base ? null : new THREE.Group();
    group.matrixAutoUpdate = false;
    const add = (make) => {
      const mesh = make(material);
      mesh.castShadow = mesh.receiveShadow = true;
      group.add(mesh);
      if (shade) { const pale = make(ghost); pale.renderOrder = -1; shade.add(pale); }
    };
    for (const [p, q] of b.rods) if (!b.base || b.rods.length === 1) add((m) => rod(p, q, b.radius, m));
    if (b.plate && !b.base) add((m) => plate(b.plate.outline, b.plate.normal, 0.9 * b.radius, m));
    if (b.base) baseMarkers(b, run, size).forEach((mesh) => group.add(mesh));
    root.add(group);
    if (shade) { shade.matrixAutoUpdate = false; soft.add(shade); }
    const lone = b.points.length === 1 && !b.base;  // a frame on something else: that has its own ball
    for (const p of b.points) {
      if ((b.base && b.walled) || (lone && meeting(place0(b, p)))) continue;
      const ball = new THREE.Mesh(ballGeometry, jointMaterial);
      ball.scale.setScalar(Math.min(1.25 * b.radius, 0.018 * size) + (b.rods.length && b.radius > 0.014 * size ? b.radius - 0.014 * size : 0));
      ball.castShadow = true;
      root.add(ball);
      s.balls.push({ball, p: V(...p), body: s.bodies.length});
      const still = new THREE.Mesh(ballGeometry, ghost); // the same joint of the rigid robot, seen side by side
      still.position.set(...p);
      still.scale.copy(ball.scale);
      if (shade) { shade.add(still); s.besides.push(still); }
    }
    s.bodies.push({data: b, group, shade, matrix: new THREE.Matrix4()});
  }
  for (const [n, k] of s.links.entries()) for (const e of [0, 1]) { // a ball where a link meets something; none at a free end
    const here = ends[2 * n + e], meets = (p) => p !== here && p.distanceTo(here) < 0.01 * size;
    if (!corners.some(meets) && !ends.some(meets)) continue;
    const ball = new THREE.Mesh(ballGeometry, jointMaterial);
    ball.scale.setScalar(Math.max(0.0085 * size, 1.05 * Math.min(k.half, 0.012 * size)));
    ball.castShadow = true;
    root.add(ball);
    s.balls.push({ball, link: k, end: e});
  }
  if (run.track && maxAbs(run.track.deviation) + spread(run.track.position) > 1e-5 * size) {
    const over = (color) => new THREE.MeshBasicMaterial({color, fog: false, depthTest: false, transparent: true});
    s.path = new Sweep(circle(0.002 * size, 6), nt, over(COLOUR.path));
    s.pathRigid = new Sweep(circle(0.0013 * size, 6), nt, over(COLOUR.pathRigid));
    s.dot = new THREE.Mesh(ballGeometry, over(COLOUR.path));
    [s.pathRigid.mesh, s.path.mesh, s.dot].forEach((mesh, i) => { mesh.renderOrder = 5 + i; });   // seen through the platform
    s.dot.scale.setScalar(0.0065 * size);
    s.pathRigid.set(run.track.rigid, across(run.track.rigid));
    s.pathGroup = new THREE.Group();
    s.pathGroup.add(s.path.mesh, s.pathRigid.mesh, s.dot);
    for (const mesh of [s.path.mesh, s.pathRigid.mesh]) mesh.castShadow = false;
    root.add(s.pathGroup);
  }
  s.forceMax = Math.max(0, ...run.forces.map((f) => norms(f.vector)));
  s.forces = s.forceMax > 0 ? run.forces.map((f) => ({data: f, arrow: arrow(size, COLOUR.force, root)})) : [];
  s.torqueMax = Math.max(0, ...run.torques.map((f) => maxAbs(f.value)));
  s.torques = s.torqueMax > 0 ? run.torques.map((f) => ({data: f, ...(f.linear ? {arrow: arrow(size, COLOUR.torque, root)} : arc(size, root))})) : [];
  const auto = run.scale, top = nice(Math.max(10 * auto, 10), true);
  s.steps = [0];
  for (let p = -1; p < 7; p++) for (const k of [1, 2, 5]) { const v = +(k * 10 ** p).toPrecision(1); if (v >= Math.min(1, auto / 10) && v <= top) s.steps.push(v); }
  if (run.mode) s.steps = [0, 0.1, 0.2, 0.5, 1, 2, 5].map((v) => v * auto);
  s.moves = s.links.length > 0 && run.largest > 0;
  return s;
}
const norms = (v) => { let m = 0; for (let i = 0; i < v.length; i += 3) m = Math.max(m, Math.hypot(v[i], v[i + 1], v[i + 2])); return m; };
function spread(c) {
  let m = 0;
  for (let i = 3; i < c.length; i++) m = Math.max(m, Math.abs(c[i] - c[i % 3]));
  return m;
}

/* Feet of the fixed frame: a flange under each joint, or a wall across a single clamped beam. */
function baseMarkers(b, run, size) {
  const material = phong(COLOUR.base), out = [], r = Math.max(2.4 * b.radius, 0.02 * size), h = 0.35 * r;
  const flange = (p, axis) => {
    const mesh = new THREE.Mesh(new THREE.CylinderGeometry(r, 1.12 * r, h, 36), material);
    mesh.position.copy(p).addScaledVector(axis, -h);
    mesh.quaternion.setFromUnitVectors(V(0, 1, 0), axis);
    mesh.castShadow = mesh.receiveShadow = true;
    out.push(mesh);
  };
  const points = b.points.map((p) => V(...p));
  if (points.length > 2) {
    points.forEach((p) => flange(p, V(0, 0, 1)));
    const flat = points.flatMap((p) => [p.x, p.y, p.z]), loop = new Float32Array([...flat, ...flat.slice(0, 3)]);
    for (let i = 0; i < points.length; i++) {
      const line = new Sweep(circle(0.0016 * size, 6), 2, new THREE.MeshBasicMaterial({color: 0xb4bcc8, fog: false})), part = loop.slice(3 * i, 3 * i + 6);
      line.set(part, across(part));
      out.push(line.mesh);
    }
    return out;
  }
  const p = points.reduce((a, c) => (c.z < a.z ? c : a)), pose = b.pose, at = V(pose[3], pose[7], pose[11]).add(p);
  const still = (a, n) => { for (let i = n; i < a.length; i += n + 3) for (let j = 0; j < 3; j++) if (Math.abs(a[i + j] - a[n + j]) > 1e-3 * size) return false; return true; };
  const beam = run.links.find((k) => V(k.rigid[0], k.rigid[1], k.rigid[2]).distanceTo(at) < 1e-3 * size);
  const k = beam && beam.rigid, n = beam ? 3 * (beam.rigid.shape[1] - 1) : 0;
  const t = beam ? V(k[n] - k[0], k[n + 1] - k[1], k[n + 2] - k[2]).normalize() : V(0, 0, 1);
  if (beam && run.links.length === 1 && Math.abs(t.z) < 0.9 && still(beam.rigid, n)) {
    const wall = new THREE.Mesh(new THREE.BoxGeometry(0.02 * size, 0.16 * size, 0.16 * size), material);
    wall.quaternion.setFromUnitVectors(V(1, 0, 0), t);
    wall.position.copy(p).addScaledVector(t, -0.01 * size);
    wall.castShadow = wall.receiveShadow = true;
    b.walled = true;
    return [wall];
  }
  flange(p, V(0, 0, 1));
  return out;
}

function arrow(size, colour, root) {
  const material = phong(colour), group = new THREE.Group();
  const shaft = new THREE.Mesh(new THREE.CylinderGeometry(1, 1, 1, 12), material);
  const head = new THREE.Mesh(new THREE.ConeGeometry(0.011 * size, 0.03 * size, 16), material);
  group.add(shaft, head);
  group.visible = false;
  root.add(group);
  return (at, direction, length) => {               // direction is a unit vector
    group.visible = length > 0.004 * size;
    if (!group.visible) return;
    const body = Math.max(length - 0.03 * size, 0.001 * size);
    group.position.copy(at);
    group.quaternion.setFromUnitVectors(V(0, 1, 0), direction);
    shaft.scale.set(0.0038 * size, body, 0.0038 * size);
    shaft.position.y = body / 2;
    head.position.y = body + 0.015 * size;
    head.scale.setScalar(Math.min(1, length / (0.03 * size)));
  };
}

function arc(size, root) {
  const n = 33, radius = 0.055 * size, group = new THREE.Group(), material = phong(COLOUR.torque);
  const sweep = new Sweep(circle(0.0038 * size, 8), n, material), head = new THREE.Mesh(new THREE.ConeGeometry(0.011 * size, 0.028 * size, 16), material);
  const c = new Float32Array(3 * n), e = V(), f = V(), p = V();
  group.add(sweep.mesh, head);
  root.add(group);
  return {group, arc: (at, axis, share) => {        // share of the largest torque, signed
    group.visible = Math.abs(share) > 0.01;
    if (!group.visible) return;
    e.set(Math.abs(axis.x) < 0.7 ? 1 : 0, Math.abs(axis.x) < 0.7 ? 0 : 1, 0);
    e.addScaledVector(axis, -e.dot(axis)).normalize();
    f.crossVectors(axis, e);
    const turn = share * 5.2;
    for (let i = 0; i < n; i++) {
      const a = turn * i / (n - 1);
      p.copy(at).addScaledVector(e, radius * Math.cos(a)).addScaledVector(f, radius * Math.sin(a));
      c[3 * i] = p.x; c[3 * i + 1] = p.y; c[3 * i + 2] = p.z;
    }
    sweep.set(c, [axis.x, axis.y, axis.z]);
    head.position.copy(p);
    const sign = Math.sign(share);
    head.quaternion.setFromUnitVectors(V(0, 1, 0), V().addScaledVector(e, -sign * Math.sin(turn)).addScaledVector(f, sign * Math.cos(turn)).normalize());
  }};
}

/* ---------------------------------------------------------------- viewer, light, camera */
let viewer = null, soft = false;
function makeViewer() {
  viewer = new MeshCat.Viewer($("meshcat-pane"));
  const stage = $("stage");
  viewer.set_3d_pane_size = function () {           // meshcat takes the whole window otherwise
    const w = stage.clientWidth, h = stage.clientHeight;
    if (!w || !h) return;
    this.camera.aspect = w / h;
    this.camera.updateProjectionMatrix();
    this.renderer.setSize(w, h);
    this.set_dirty();
  };
  window.onload = null;
  new ResizeObserver(() => {
    viewer.set_3d_pane_size();
    if (!R) return;
    if (!cameraMoved) fitCamera();
    drawPlots();
    viewer.render();                                // at once: a screenshot may be taken before the next frame
    place();
  }).observe(stage);
  const gl = viewer.renderer.getContext(), info = gl.getExtension("WEBGL_debug_renderer_info");
  soft = /swiftshader|llvmpipe|software/i.test(info ? String(gl.getParameter(info.UNMASKED_RENDERER_WEBGL)) : "");
  const wish = new URLSearchParams(location.hash.slice(1)).get("shadow");
  viewer.renderer.shadowMap.enabled = wish ? wish === "1" : !soft;   // software drawing: half the speed with shadows
  viewer.renderer.setPixelRatio(soft ? 1 : Math.min(devicePixelRatio, 2));
  viewer.set_property(["Background"], "top_color", [1, 1, 1]);
  viewer.set_property(["Background"], "bottom_color", [0.885, 0.91, 0.945]);
  viewer.delete_path(["Lights"]);
  viewer.set_property(["Axes"], "visible", false);
  viewer.camera.fov = 32;
  viewer.controls.addEventListener("change", () => place());
  viewer.controls.addEventListener("start", () => { cameraMoved = true; });
  viewer.controls.addEventListener("end", writeHash);
}

function light(size, centre, floor) {
  const sun = new THREE.DirectionalLight(0xffffff, 0.42), d = V(0.3, -0.75, 1.3).normalize();
  sun.position.copy(centre).addScaledVector(d, 3 * size);
  sun.target.position.copy(centre);
  if (viewer.renderer.shadowMap.enabled) {
    sun.castShadow = true;
    sun.shadow.mapSize.set(2048, 2048);
    const c = sun.shadow.camera;
    c.left = c.bottom = -1.1 * size; c.right = c.top = 1.1 * size; c.near = 0.5 * size; c.far = 6 * size;
    sun.shadow.radius = 4; sun.shadow.bias = -0.0006; sun.shadow.normalBias = 0.002 * size;
  }
  viewer.set_object(["light", "sky"], new THREE.HemisphereLight(0xffffff, 0xccd3de, 0.56));
  viewer.set_object(["light", "sun"], sun);
  viewer.set_object(["light", "aim"], sun.target);
  const cell = nice(size / 8), count = 2 * Math.ceil(3 * size / cell);
  const grid = new THREE.GridHelper(count * cell, count, 0x6d7889, 0x8f99a8);
  grid.rotateX(Math.PI / 2);
  grid.position.set(Math.round(centre.x / cell) * cell, Math.round(centre.y / cell) * cell, floor);
  grid.material.transparent = true; grid.material.opacity = 0.3; grid.material.depthWrite = false;
  viewer.set_object(["Grid"], grid);
  viewer.scene.fog = new THREE.Fog(0xf3f6fa, 2.6 * size, 6.5 * size);
  const ground = new THREE.Mesh(new THREE.PlaneGeometry(8 * size, 8 * size), new THREE.ShadowMaterial({opacity: 0.16, fog: false}));
  ground.position.set(centre.x, centre.y, floor - 1e-4 * size);
  ground.receiveShadow = true;
  viewer.set_object(["ground"], ground);
  return cell;
}

/* Points that the whole motion passes through, at the shown magnification. */
function cloud() {
  const out = [], step = Math.max(1, Math.floor(scene.nt / 24)), keep = S.t, p = V();
  for (let k = 0; k < scene.nt; k += step) {
    move(k, 0);
    for (const b of scene.links) for (let i = 0; i < b.m; i += 4) out.push(V(b.c[3 * i], b.c[3 * i + 1], b.c[3 * i + 2]));
    for (const b of scene.balls) out.push(b.ball.position.clone());
  }
  if (S.ghost === "beside") out.push(...out.map((q) => q.clone().add(scene.aside)));
  S.t = keep;
  return out.length ? out : [V(0, 0, 0), V(1, 1, 1)];
}

function fitCamera(points) {
  points = points || cloud();
  const low = points[0].clone(), high = points[0].clone();
  points.forEach((p) => { low.min(p); high.max(p); });
  const e = V().subVectors(high, low), most = Math.max(e.x, e.y, e.z) || 1, least = Math.min(e.x, e.y, e.z);
  let d = V(0.62, -1, 0.42);                        // a spatial mechanism: from the front, a little above
  if (least < 0.15 * most) d = e.z === least ? V(0, -0.62, 1) : e.y === least ? V(0.16, -1, 0.14) : V(1, -0.16, 0.14);
  d.normalize();
  const up = V(0, 0, 1), right = V().crossVectors(up, d).normalize(), top = V().crossVectors(d, right);
  const w = $("stage").clientWidth || 1, h = $("stage").clientHeight || 1, tall = Math.tan(16 * Math.PI / 180), wide = tall * w / h;
  /* the legend covers the left edge of a wide page and the top of a narrow one */
  const narrow = w < 700, padX = narrow ? 1.02 : 1.06, padY = narrow ? 1.3 : 1.1, side = narrow ? 0 : Math.min(0.35, 190 / w);
  const rim = 0.035 * scene.size;                   // points stand for joints and feet with a size
  let centre = V().addVectors(low, high).multiplyScalar(0.5), distance = 1;
  for (let pass = 0; pass < 4; pass++) {            // centre what is seen, then step back just enough
    distance = 0;
    let l = Infinity, r = -Infinity, b = Infinity, t = -Infinity;
    for (const p of points) {
      const q = V().subVectors(p, centre), x = q.dot(right), y = q.dot(top), z = q.dot(d);
      distance = Math.max(distance, z + (Math.abs(x) * padX + rim) / wide / (1 - side), z + (Math.abs(y) * padY + rim) / tall);
      l = Math.min(l, x); r = Math.max(r, x); b = Math.min(b, y); t = Math.max(t, y);
    }
    centre.addScaledVector(right, (l + r) / 2).addScaledVector(top, (b + t) / 2);
  }
  distance = Math.max(distance, 0.6 * scene.size);
  let half = 0;
  for (const p of points) { const q = V().subVectors(p, centre); half = Math.max(half, (Math.abs(q.dot(right)) + rim) / wide / (distance - q.dot(d))); }
  const shift = clamp(2 * side - 1 + half, narrow ? 0 : 0.03, side); // no further from the middle than the legend asks
  const target = centre.clone().addScaledVector(right, -shift * wide * distance);
  if (narrow) target.addScaledVector(top, 0.06 * tall * distance);
  const world = (p) => V(p.x, p.z, -p.y);           // meshcat's camera lives in a y-up world
  viewer.controls.target.copy(world(target));
  viewer.camera.position.copy(world(target.clone().addScaledVector(d, distance)));
  viewer.camera.near = distance / 100; viewer.camera.far = distance * 40;
  viewer.camera.updateProjectionMatrix();
  viewer.scene.fog.near = 1.15 * distance; viewer.scene.fog.far = distance + 3.2 * scene.size;
  viewer.controls.update();
  viewer.set_dirty();
  seek(S.t);
}

/* ---------------------------------------------------------------- motion */
/* Row k + w of an array with n numbers a row: a cubic through the instants about it, with the same
   weights for every point, so that shared points stay shared and fast turns keep their radius. */
const lerp = (a, n, k, w, out) => {
  if (w === 0) { for (let i = 0, p = k * n; i < n; i++) out[i] = a[p + i]; return out; }
  const [u0, u1, u2, u3] = weights(k, w), p1 = k * n, p2 = p1 + n, p0 = Math.max(p1 - n, 0), p3 = k + 2 < R.t.length ? p2 + n : p2;
  for (let i = 0; i < n; i++) out[i] = u0 * a[p0 + i] + u1 * a[p1 + i] + u2 * a[p2 + i] + u3 * a[p3 + i];
  return out;
};
let weightsAt = [-1, 0, null, null];
function weights(k, w) {
  if (weightsAt[0] === k && weightsAt[1] === w && weightsAt[2] === R) return weightsAt[3];
  const T = R.t, h = T[k + 1] - T[k], w2 = w * w, w3 = w2 * w, u = [0, 2 * w3 - 3 * w2 + 1, 3 * w2 - 2 * w3, 0];
  const slope = (f, i) => {                         // slope at instant k + i, times h f; one-sided at the ends
    const j = k + i, a = Math.max(j - 1, 0), b = Math.min(j + 1, T.length - 1), d = h * f / (T[b] - T[a]);
    u[b - k + 1] += d; u[a - k + 1] -= d;
  };
  slope(w3 - 2 * w2 + w, 0); slope(w3 - w2, 1);
  weightsAt = [k, w, R, u];
  return u;
}
const row = new Float32Array(12), rowRigid = new Float32Array(12), three = new Float32Array(3), threeRigid = new Float32Array(3);

function frameOf(t) {
  const T = R.t;
  let a = 0, b = T.length - 1;
  if (b === 0 || t <= T[0]) return [0, 0];
  if (t >= T[b]) return [b, 0];
  while (b - a > 1) { const m = (a + b) >> 1; if (T[m] <= t) a = m; else b = m; }
  return [a, (t - T[a]) / (T[b] - T[a])];
}

function move(k, w) {
  const mag = S.mag, field = S.field, top = fullMax(), low = scene.signed ? -top : 0;
  for (const b of scene.links) {
    const d = b.data, m = b.m, c = b.c;
    lerp(d.rigid, b.straight ? 6 : 3 * m, k, w, b.rigid);
    lerp(d.disp, 3 * m, k, w, c);
    for (let i = 0; i < m; i++) for (let a = 0; a < 3; a++) {
      const r = b.straight ? b.rigid[a] * (1 - b.share[i]) + b.rigid[3 + a] * b.share[i] : b.rigid[3 * i + a];
      b.r[3 * i + a] = r;
      c[3 * i + a] = r + mag * c[3 * i + a];
    }
    lerp(d.y_rigid, 3, k, w, three);
    lerp(d.y, 3 * m, k, w, b.y);
    for (let i = 0; i < 3 * m; i++) b.y[i] = three[i % 3] + mag * (b.y[i] - three[i % 3]);
    if (b.fields[field]) lerp(b.fields[field], m, k, w, b.now); else b.now.fill(0);
    const factor = scene.factor;
    for (let i = 0; i < m; i++) b.value[i] = clamp((b.now[i] * factor - low) / (top - low), 0, 1);
    b.sweep.mesh.material = S.colours ? b.coloured : b.plain;
    b.sweep.set(c, b.y, b.value);
    if (S.ghost !== "off") b.shade.set(b.rigid, three);
  }
  for (const b of scene.bodies) {
    const d = b.data, still = d.pose.length === 12;
    lerp(d.pose, 12, still ? 0 : k, still ? 0 : w, row);
    if (d.rigid) { lerp(d.rigid, 12, k, w, rowRigid); } else rowRigid.set(row);
    if (b.shade) { b.shade.matrix.set(...rowRigid, 0, 0, 0, 1); b.shade.matrixWorldNeedsUpdate = true; }
    for (let i = 0; i < 12; i++) row[i] = rowRigid[i] + mag * (row[i] - rowRigid[i]);
    b.matrix.set(...row, 0, 0, 0, 1);
    b.group.matrix.copy(b.matrix);
    b.group.matrixWorldNeedsUpdate = true;
  }
  for (const b of scene.balls) {
    if (b.link) { const i = b.end ? 3 * (b.link.m - 1) : 0; b.ball.position.set(b.link.c[i], b.link.c[i + 1], b.link.c[i + 2]); }
    else b.ball.position.copy(b.p).applyMatrix4(scene.bodies[b.body].matrix);
  }
}

function magnified(at, rigid, k, w, out) {
  lerp(at, 3, k, w, three); lerp(rigid, 3, k, w, threeRigid);
  return out.set(...[0, 1, 2].map((i) => threeRigid[i] + S.mag * (three[i] - threeRigid[i])));
}

function drawPath() {
  if (!scene.path) return;
  const {position, rigid} = R.track, c = new Float32Array(position.length);
  for (let i = 0; i < c.length; i++) c[i] = rigid[i] + S.mag * (position[i] - rigid[i]);
  scene.path.set(c, across(c));
}

const spot = V(), way = V();
function seek(t) {
  if (!isFinite(t)) return;
  S.t = clamp(t, R.t[0], R.t[R.t.length - 1]);
  const [k, w] = frameOf(S.t);
  move(k, w);
  scene.soft.visible = S.ghost !== "off";
  scene.soft.position.copy(S.ghost === "beside" ? scene.aside : V(0, 0, 0));
  scene.ghostMaterial.opacity = S.ghost === "beside" ? 1 : 0.22;
  for (const mesh of scene.besides) mesh.visible = S.ghost === "beside";
  scene.ghostMaterial.depthWrite = S.ghost === "beside";
  if (scene.path) {
    scene.pathGroup.visible = S.path;
    magnified(R.track.position, R.track.rigid, k, w, scene.dot.position);
  }
  for (const f of scene.forces) {
    lerp(f.data.vector, 3, k, w, three);
    way.set(...three);
    const n = S.force ? way.length() : 0;
    f.arrow(magnified(f.data.at, f.data.at_rigid, k, w, spot), way.normalize(), 0.24 * scene.size * n / scene.forceMax);
  }
  for (const f of scene.torques) {
    lerp(f.data.vector, 3, k, w, three);
    way.set(...three).normalize();
    const value = S.torque ? (f.data.value[k] * (1 - w) + (w > 0 ? f.data.value[k + 1] * w : 0)) / scene.torqueMax : 0;
    magnified(f.data.at, f.data.at_rigid, k, w, spot);
    if (f.arc) f.arc(spot, way, value);
    else f.arrow(spot, way.multiplyScalar(Math.sign(value) || 1), 0.24 * scene.size * Math.abs(value));
  }
  viewer.set_dirty();
  refresh(k, w);
  place();
  writeHash();
}

function setMag(mag) {
  if (!isFinite(mag) || mag < 0) return;
  S.mag = scene.moves ? mag : 1;
  drawPath();
  seek(S.t);
  showControls();
}

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
      if (Math.abs(v) > Math.abs(best.value)) Object.assign(best, {value: v, link: b, frame: Math.floor(i / b.m), station: i % b.m});
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
  const ticks = [0, 0.25, 0.5, 0.75, 1].map((u) => el("span", {style: `--u:${u}`}, minus(digits(low + u * (top - low)))));
  const limited = S.limit > 0 && isStress();
  if (limited && S.limit < top) ticks.push(el("b", {style: `--u:${(S.limit - low) / (top - low)}`}, ""));
  $("ticks").replaceChildren(...ticks);
  const keys = [];
  if (S.max > 0 && S.max < 0.999 * fieldMax()) keys.push([null, `run maximum ${digits(fieldMax())} ${f.unit}`]);
  if (limited) keys.push(["limit", `limit ${digits(S.limit)} ${f.unit}${fieldMax() > S.limit ? ", exceeded" : ""}`]);
  if (S.force && scene.forceMax) keys.push(["force", `joint force, longest ${digits(scene.forceMax)} N`]);
  if (S.torque && scene.torqueMax) keys.push(["torque", `motor torque, largest ${digits(scene.torqueMax)} N m`]);
  if (S.path && scene.path) keys.push(["path", `path of ${R.track.name}`]);
  if (S.ghost !== "off" && scene.moves) keys.push(["ghost", "rigid mechanism"]);
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
  for (const b of scene.links) for (let i = 0; i < b.m; i++)
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
let marks = [];
function place() {
  if (!R || !scene) return;
  const want = [];
  viewer.camera.updateMatrixWorld();
  const at = (b, i) => project(b.c[3 * i], b.c[3 * i + 1], b.c[3 * i + 2]);
  if (S.names) for (const b of scene.links) want.push(["name", b.data.name, at(b, Math.round(0.3 * (b.m - 1)))]);
  const f = fieldOf(S.field);
  if (S.peak && S.colours && scene.top && f && !R.mode) {
    const v = scene.top.link.now[scene.top.i] * scene.factor;
    if (Math.abs(v) > 0) want.push(["peak" + (S.limit > 0 && isStress() && Math.abs(v) > S.limit ? " over" : ""), `${minus(digits(v))} ${f.unit}`, at(scene.top.link, scene.top.i)]);
  }
  while (marks.length < want.length) { const m = el("div"); $("labels").append(m); marks.push(m); }
  marks.forEach((m, i) => {
    m.hidden = i >= want.length;
    if (m.hidden) return;
    const [kind, text, [x, y]] = want[i];
    m.className = "mark " + kind + (x > $("stage").clientWidth - 90 ? " left" : "");
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
  tip.hidden = !best;
  if (!best) return;
  const lines = describe(best.b, best.i, best.u);
  tip.replaceChildren(el("b", {}, lines[0]), ...lines.slice(1).map((s) => el("div", {}, s)));
  tip.style.left = clamp(x + 14, 4, box.width - tip.offsetWidth - 4) + "px";
  tip.style.top = clamp(y + 14, 4, box.height - tip.offsetHeight - 4) + "px";
}
function describe(b, i, u) {
  const mix = (a) => a[i] * (1 - u) + a[Math.min(i + 1, b.m - 1)] * u, [k, w] = frameOf(S.t), out = [b.data.name];
  out.push(`x = ${digits(1e3 * mix(b.data.x))} of ${digits(1e3 * b.data.length)} mm`);
  for (const f of R.fields) {
    const v = mix(lerp(b.fields[f.key], b.m, k, w, new Float32Array(b.m)));
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
  const boxes = list.map((p) => el("figure", {}, el("figcaption", {}, el("b", {}, `${p.title} [${p.unit}]`), el("span", {class: "values"}))));
  host.append(...boxes);                           // all in place before any is measured
  for (const [n, p] of list.entries()) {
    const box = boxes[n], svg = el("svg", {role: "img", "aria-label": `${p.title} over time`});
    box.append(svg);
    const w = Math.max(box.clientWidth - 12, 60), h = Math.max(box.clientHeight - box.firstChild.offsetHeight - 4, 40), left = 38, right = 6, low = 15, T = R.t;
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
    plots.push({p, cursor, X, values: box.querySelector(".values")});
  }
  movePlots();
}
function movePlots() {
  if (!plots.length) return;
  const [k, w] = frameOf(S.t);
  for (const {p, cursor, X, values} of plots) {
    cursor.setAttribute("x1", X(S.t)); cursor.setAttribute("x2", X(S.t));
    const some = p.curves.filter((c) => !c.rigid).slice(0, 8);
    const texts = some.map((c) => minus(digits(c.y[k] * (1 - w) + (w > 0 ? c.y[k + 1] * w : 0))));
    const room = values.parentNode.clientWidth / 6.9 - p.title.length - 14 - 3 * some.length;
    const named = some.length > 1 && some.reduce((n, c) => n + c.name.length + 6, 0) < room;   // a steady guess: widths change with the values
    const now = some.map((c, i) => el("span", {style: `color:${CURVES[c.colour % CURVES.length]}`, title: c.name}, (named ? c.name + " " : "") + texts[i]));
    if (p.curves.some((c) => c.rigid)) now.unshift(el("span", {class: "dash"}, "┄ rigid"));
    values.replaceChildren(...now);
  }
}

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
    for (const u of [0, 0.25, 0.5, 0.75, 1]) g.fillText(minus(digits(low + u * (top - low))), 42, 98 + 180 * (1 - u));
  }
  g.font = "600 13px system-ui, sans-serif";
  for (const m of marks) if (!m.hidden) { const [, x, y] = m.style.transform.match(/([\d.-]+)px, ([\d.-]+)px/); g.fillText(m.textContent, +x + 10, +y - 8); }
  return c.toDataURL("image/png");
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
  scene.aside.set(1.15 * e.x, 0, 0);
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
  S.t = clamp(from.t ?? S.t, R.t[0], R.t[R.t.length - 1]);
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
})();
