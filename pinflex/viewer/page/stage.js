/* stage.js: the viewer with its light and camera, and what moves in it.

Every material point is drawn at r_rigid + mag (r - r_rigid), in world coordinates. Bodies follow
the same rule, so their drawn motion is the affine map R_rigid + mag (R - R_rigid), and a point
that two bodies share stays shared: joints do not open at any magnification. */
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
    setColours();
    drawPlots();
    viewer.render();                                // at once: a screenshot may be taken before the next frame
    place();
  }).observe(stage);
  const gl = viewer.renderer.getContext(), info = gl.getExtension("WEBGL_debug_renderer_info");
  soft = /swiftshader|llvmpipe|software/i.test(info ? String(gl.getParameter(info.UNMASKED_RENDERER_WEBGL)) : "");
  const wish = new URLSearchParams(location.hash.slice(1)), shadow = wish.get("shadow");   // still pictures ask for the best
  viewer.renderer.shadowMap.enabled = shadow ? shadow === "1" : !soft;   // software drawing: half the speed with shadows
  viewer.renderer.setPixelRatio(+wish.get("sharp") > 0 ? Math.min(+wish.get("sharp"), 4) : soft ? 1 : Math.min(devicePixelRatio, 2));
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
    for (const b of scene.bodies) for (const p of b.box) out.push(p.clone().applyMatrix4(b.matrix));
    for (const b of scene.links) if (b.meshed) for (const e of [0, 3 * (b.m - 1)]) for (const i of [0, 1, 2]) for (const sign of [-1, 1])
      out.push(p.fromArray(b.c, e).setComponent(i, b.c[e + i] + sign * b.half).clone());
  }
  if (S.ghost === "beside") out.push(...out.map((q) => q.clone().add(scene.aside)));
  S.t = keep;
  return out.length ? out : [V(0, 0, 0), V(1, 1, 1)];
}

/* The side from which a robot of the extent e is seen. */
function viewFrom(e) {
  const most = Math.max(e.x, e.y, e.z) || 1, least = Math.min(e.x, e.y, e.z);
  if (least >= 0.15 * most) return V(0.62, -1, 0.42).normalize();   // a spatial mechanism: from the front, a little above
  return (e.z === least ? V(0, -0.62, 1) : e.y === least ? V(0.16, -1, 0.14) : V(1, -0.16, 0.14)).normalize();
}

function fitCamera(points) {
  points = points || cloud();
  const low = points[0].clone(), high = points[0].clone();
  points.forEach((p) => { low.min(p); high.max(p); });
  const d = viewFrom(scene.extent);
  const up = V(0, 0, 1), right = V().crossVectors(up, d).normalize(), top = V().crossVectors(d, right);
  const w = $("stage").clientWidth || 1, h = $("stage").clientHeight || 1, tall = Math.tan(16 * Math.PI / 180), wide = tall * w / h;
  /* the legend covers the left edge of a wide page and the top of a narrow one */
  const narrow = w < 700, padX = narrow ? 1.02 : 1.06, padY = narrow ? 1.3 : 1.14, side = narrow ? 0 : Math.min(0.35, 190 / w);
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
  target.addScaledVector(top, (narrow ? 0.06 : 0.03) * tall * distance);   // the heading covers some of the top
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
    lerp(d.y_disp, 3 * m, k, w, b.y);
    for (let i = 0; i < 3 * m; i++) b.y[i] = three[i % 3] + mag * b.y[i];
    const f = b.fields[field], n = f ? f.shape[1] : m, factor = scene.factor;
    if (b.now.length !== n) { b.now = new Float32Array(n); b.value = new Float32Array(n); }
    if (f) lerp(f, n, k, w, b.now); else b.now.fill(0);
    for (let i = 0; i < n; i++) b.value[i] = clamp((b.now[i] * factor - low) / (top - low), 0, 1);
    b.sweep.mesh.material = S.colours ? b.coloured : b.plain;
    b.sweep.set(c, b.y, b.value, b.onSurface(field));
    if (S.ghost !== "off") b.shade.set(b.rigid, three);
  }
  for (const b of scene.bodies) {
    const d = b.data, still = d.rigid.length === 12;
    lerp(d.rigid, 12, still ? 0 : k, still ? 0 : w, rowRigid);
    b.shade.matrix.set(...rowRigid, 0, 0, 0, 1);
    b.shade.matrixWorldNeedsUpdate = true;
    if (d.disp) lerp(d.disp, 12, k, w, row); else row.fill(0);
    for (let i = 0; i < 12; i++) row[i] = rowRigid[i] + mag * row[i];
    b.matrix.set(...row, 0, 0, 0, 1);
    b.group.matrix.copy(b.matrix);
    b.group.matrixWorldNeedsUpdate = true;
  }
  for (const b of scene.balls) {
    if (b.link) { const i = b.end ? 3 * (b.link.m - 1) : 0; b.ball.position.set(b.link.c[i], b.link.c[i + 1], b.link.c[i + 2]); }
    else b.ball.position.copy(b.p).applyMatrix4(scene.bodies[b.body].matrix);
  }
}

function magnified({rigid, disp}, k, w, out) {
  lerp(disp, 3, k, w, three); lerp(rigid, 3, k, w, threeRigid);
  return out.set(...[0, 1, 2].map((i) => threeRigid[i] + S.mag * three[i]));
}

function drawPath() {
  if (!scene.path) return;
  const {disp, rigid} = R.track, c = new Float32Array(rigid.length);
  for (let i = 0; i < c.length; i++) c[i] = rigid[i] + S.mag * disp[i];
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
    magnified(R.track, k, w, scene.dot.position);
  }
  for (const f of scene.forces) {
    lerp(f.data.vector, 3, k, w, three);
    way.set(...three);
    const n = S.force ? way.length() : 0;
    f.arrow(magnified(f.data, k, w, spot), way.normalize(), 0.24 * scene.size * n / scene.forceMax);
  }
  for (const f of scene.torques) {
    lerp(f.data.vector, 3, k, w, three);
    way.set(...three).normalize();
    const value = S.torque ? (f.data.value[k] * (1 - w) + (w > 0 ? f.data.value[k + 1] * w : 0)) / scene.torqueMax : 0;
    magnified(f.data, k, w, spot);
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

