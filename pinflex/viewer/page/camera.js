/* camera.js: from where the robot is seen, so that all of its motion fits. */
const VIEWS = {front: [0, -1, 0], side: [1, 0, 0], top: [0, -1e-3, 1], iso: [0.62, -0.75, 0.55]};
let preset = "fit";

/* Points that the whole motion passes through, at the shown magnification. */
function cloud() {
  const out = [], step = Math.max(1, Math.floor(scene.nt / 24)), p = V();
  for (let k = 0; k < scene.nt; k += step) {
    moveRobot(scene.robot, {k, w: 0}, S.mag);
    for (const b of scene.links) for (let i = 0; i < b.m; i += 4) out.push(V(b.c[3 * i], b.c[3 * i + 1], b.c[3 * i + 2]));
    for (const b of scene.balls) out.push(b.ball.position.clone());
    for (const b of scene.bodies) for (const p of b.box) out.push(p.clone().applyMatrix4(b.matrix));
    for (const b of scene.links) if (b.meshed) for (const e of [0, 3 * (b.m - 1)]) for (const i of [0, 1, 2]) for (const sign of [-1, 1])
      out.push(p.fromArray(b.c, e).setComponent(i, b.c[e + i] + sign * b.half).clone());
  }
  if (S.ghost === "beside" && comparable()) out.push(...out.map((q) => q.clone().add(scene.aside)));
  return out.length ? out : [V(0, 0, 0), V(1, 1, 1)];
}
function boxOf(points) {
  const low = points[0].clone(), high = low.clone();
  points.forEach((p) => { low.min(p); high.max(p); });
  return {low, high, extent: V().subVectors(high, low), centre: V().addVectors(low, high).multiplyScalar(0.5)};
}

/* The side from which a robot of the extent e is seen. */
function viewFrom(e) {
  if (VIEWS[preset]) return V(...VIEWS[preset]).normalize();
  const most = Math.max(e.x, e.y, e.z) || 1, least = Math.min(e.x, e.y, e.z);
  if (least >= 0.15 * most) return V(0.62, -1, 0.42).normalize();   // a spatial mechanism: from the front, a little above
  return (e.z === least ? V(0, -0.62, 1) : e.y === least ? V(0.16, -1, 0.14) : V(1, -0.16, 0.14)).normalize();
}
function look(name) {
  preset = name;
  cameraMoved = false;
  fitCamera();
  pressed(name);
  writeHash();
}
function pressed(name) {
  for (const b of document.querySelectorAll("#views button")) b.setAttribute("aria-pressed", b.id === "view-" + name);
}

/* What the texts over the drawing leave free: shares of the width at the left and of the height above and below. */
function margins(w, h) {
  const top = Math.min(0.3, 0.8 * ($("head").offsetHeight + 10) / h);
  if (innerWidth <= 620) return {side: 0, top, below: Math.min(0.25, ($("compass").offsetHeight ? 110 : 60) / h)};   // as small.css has it
  if (h < 480) return {side: Math.min(0.35, 140 / w), top, below: Math.min(0.15, 40 / h)};
  return {side: Math.min(0.35, 200 / w), top: 0.08, below: 0.05};
}

function fitCamera() {
  const points = cloud(), {centre} = boxOf(points), d = viewFrom(scene.extent);
  const up = V(0, 0, 1), right = V().crossVectors(up, d).normalize(), top = V().crossVectors(d, right);
  const w = $("stage").clientWidth || 1, h = $("stage").clientHeight || 1, tall = Math.tan(FOV * Math.PI / 360), wide = tall * w / h;
  const free = margins(w, h), highest = 1 - free.top - free.below, rim = 0.035 * scene.size;   // points stand for joints and feet with a size
  let distance = 1;
  for (let pass = 0; pass < 4; pass++) {            // centre what is seen, then step back just enough
    distance = 0;
    let l = Infinity, r = -Infinity, b = Infinity, t = -Infinity;
    for (const p of points) {
      const q = V().subVectors(p, centre), x = q.dot(right), y = q.dot(top), z = q.dot(d);
      distance = Math.max(distance, z + (Math.abs(x) * 1.04 + rim) / wide / (1 - free.side), z + (Math.abs(y) + rim) / tall / highest);
      l = Math.min(l, x); r = Math.max(r, x); b = Math.min(b, y); t = Math.max(t, y);
    }
    centre.addScaledVector(right, (l + r) / 2).addScaledVector(top, (b + t) / 2);
  }
  distance = Math.max(distance, 0.6 * scene.size);
  let half = 0;
  for (const p of points) { const q = V().subVectors(p, centre); half = Math.max(half, (Math.abs(q.dot(right)) + rim) / wide / (distance - q.dot(d))); }
  const shift = clamp(2 * free.side - 1 + half, free.side ? 0.03 : 0, free.side); // no further from the middle than the legend asks
  const target = centre.addScaledVector(right, -shift * wide * distance).addScaledVector(top, (free.top - free.below) * tall * distance);
  aim(target, target.clone().addScaledVector(d, distance), distance);
  seek(S.t);
}
function aim(target, position, distance) {
  viewer.controls.target.copy(target);
  viewer.camera.position.copy(position);
  viewer.camera.near = distance / 100; viewer.camera.far = distance * 40;
  viewer.camera.updateProjectionMatrix();
  viewer.scene.fog.near = 1.15 * distance; viewer.scene.fog.far = distance + 3.2 * scene.size;
  viewer.controls.update();
  viewer.dirty();
}
