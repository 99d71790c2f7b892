/* motion.js: moves a robot to an instant.

Every material point is drawn at r_rigid + mag (r - r_rigid), in world coordinates. Bodies follow
the same rule, so their drawn motion is the affine map R_rigid + mag (R - R_rigid), and a point
that two bodies share stays shared: joints do not open at any magnification. */
function frameOf(t, T = R.t) {
  let a = 0, b = T.length - 1;
  if (b === 0 || t <= T[0]) return [0, 0];
  if (t >= T[b]) return [b, 0];
  while (b - a > 1) { const m = (a + b) >> 1; if (T[m] <= t) a = m; else b = m; }
  return [a, (t - T[a]) / (T[b] - T[a])];
}

/* Where t lies among the instants T: between rows k and k + 1 at share w; and the weights of the four
   rows about it by a cubic, the same for every point, so that shared points stay shared and fast
   turns keep their radius. */
function instant(t, T = R.t) {
  const [k, w] = frameOf(t, T);
  if (w === 0) return {k, w};
  const h = T[k + 1] - T[k], w2 = w * w, w3 = w2 * w, u = [0, 2 * w3 - 3 * w2 + 1, 3 * w2 - 2 * w3, 0];
  const slope = (f, i) => {                         // slope at instant k + i, times h f; one-sided at the ends
    const j = k + i, a = Math.max(j - 1, 0), b = Math.min(j + 1, T.length - 1), d = h * f / (T[b] - T[a]);
    u[b - k + 1] += d; u[a - k + 1] -= d;
  };
  slope(w3 - 2 * w2 + w, 0); slope(w3 - w2, 1);
  return {k, w, u, last: T.length - 1};
}
/* Row at an instant of an array with n numbers a row. */
function lerp(a, n, {k, w, u, last}, out) {
  if (w === 0) { for (let i = 0, p = k * n; i < n; i++) out[i] = a[p + i]; return out; }
  const [u0, u1, u2, u3] = u, p1 = k * n, p2 = p1 + n, p0 = Math.max(p1 - n, 0), p3 = k + 2 <= last ? p2 + n : p2;
  for (let i = 0; i < n; i++) out[i] = u0 * a[p0 + i] + u1 * a[p1 + i] + u2 * a[p2 + i] + u3 * a[p3 + i];
  return out;
}
const mixed = (y, {k, w}) => y[k] * (1 - w) + (w > 0 ? y[k + 1] * w : 0);   // of a curve, as it is plotted
const row = new Float32Array(12), rowRigid = new Float32Array(12), normal = new Float32Array(3);

function moveRobot(robot, at, mag) {
  for (const b of robot.links) {
    const d = b.data, m = b.m, c = b.c;
    lerp(d.rigid, b.rigid.length, at, b.rigid);
    lerp(d.disp, 3 * m, at, c);
    for (let i = 0; i < m; i++) for (let a = 0; a < 3; a++) {
      const r = b.straight ? b.rigid[a] * (1 - b.share[i]) + b.rigid[3 + a] * b.share[i] : b.rigid[3 * i + a];
      b.r[3 * i + a] = r;
      c[3 * i + a] = r + mag * c[3 * i + a];
    }
    lerp(d.y_rigid, 3, at, normal);
    lerp(d.y_disp, 3 * m, at, b.y);
    for (let i = 0; i < 3 * m; i++) b.y[i] = normal[i % 3] + mag * b.y[i];
  }
  for (const b of robot.bodies) {
    const d = b.data;
    lerp(d.rigid, 12, d.rigid.length === 12 ? STILL : at, rowRigid);
    if (d.disp) lerp(d.disp, 12, at, row); else row.fill(0);
    for (let i = 0; i < 12; i++) row[i] = rowRigid[i] + mag * row[i];
    b.matrix.set(...row, 0, 0, 0, 1);
    b.group.matrix.copy(b.matrix);
    b.group.matrixWorldNeedsUpdate = true;
  }
  for (const b of robot.balls) {
    if (b.link) { const i = b.end ? 3 * (b.link.m - 1) : 0; b.ball.position.set(b.link.c[i], b.link.c[i + 1], b.link.c[i + 2]); }
    else b.ball.position.copy(b.p).applyMatrix4(robot.bodies[b.body].matrix);
  }
  for (const s of robot.stems) {
    V().copy(s.start).applyMatrix4(s.on.matrix).toArray(s.c);
    if (s.link) s.c.set(s.link.c.subarray(0, 3), 3); else V().setFromMatrixPosition(s.body.matrix).toArray(s.c, 3);
    s.sweep.set(s.c, across(s.c));
  }
}
const STILL = {k: 0, w: 0};

/* Sweeps of the links, coloured by the field shown. */
function colourLinks(links, at) {
  const field = S.field, top = fullMax(), low = scene.signed ? -top : 0;
  for (const b of links) {
    const f = fieldValues(b, field), n = f ? f.shape[1] : b.m, factor = scene.factor;
    if (b.now.length !== n) { b.now = new Float32Array(n); b.value = new Float32Array(n); }
    if (f) lerp(f, n, at, b.now); else b.now.fill(0);
    for (let i = 0; i < n; i++) b.value[i] = clamp((b.now[i] * factor - low) / (top - low), 0, 1);
    b.sweep.mesh.material = S.colours && f ? scene.coloured : scene.plain;
    b.sweep.set(b.c, b.y, b.value, b.onSurface(sourceOf(field)));
  }
}

function seek(t) {
  if (!isFinite(t)) return;
  S.t = clamp(t, R.t[0], R.t[R.t.length - 1]);
  const at = instant(S.t);
  moveRobot(scene.robot, at, S.mag);
  colourLinks(scene.links, at);
  drawGhost();
  drawDot(at);
  drawArrows(at);
  viewer.dirty();
  refresh(at);
  place();
  writeHash();
}

function setMag(mag) {
  if (!isFinite(mag) || mag < 0) return;
  S.mag = scene.moves || otherRun() ? mag : 1;
  drawPath();
  seek(S.t);
  showControls();
}
