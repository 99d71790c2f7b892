/* sweep.js: shapes that three.js has not: a profile along a line, a rod, a plate. */
const V = (x, y, z) => new THREE.Vector3(x, y, z);
const phong = (color, more) => new THREE.MeshPhongMaterial({color, shininess: 28, specular: 0x1c1c1c, fog: false, ...more});

/* Another index of a geometry, of fewer triangles, for drawings in motion (viewer.js). */
const SIDES = 8;                                   // that a round profile has there
function lighter(geometry, index) {
  const fine = geometry.index;
  geometry.setIndex(index);
  Object.assign(geometry.userData, {fine, coarse: geometry.index});
  geometry.setIndex(fine);
}

/* Axes of the sections along a polyline c: t along it, y as wished but square to it, z. */
function sections(c, ys, one, count, t, y, z) {
  let tx = 1, ty = 0, tz = 0;
  for (let i = 0; i < count; i++) {
    const p = 3 * Math.max(i - 1, 0), q = 3 * Math.min(i + 1, count - 1), a = 3 * i, s = one ? 0 : a;
    const ax = c[q] - c[p], ay = c[q + 1] - c[p + 1], az = c[q + 2] - c[p + 2], l = Math.hypot(ax, ay, az);
    if (l > 1e-12) { tx = ax / l; ty = ay / l; tz = az / l; }
    let yx = ys[s], yy = ys[s + 1], yz = ys[s + 2];
    const d = yx * tx + yy * ty + yz * tz;
    yx -= d * tx; yy -= d * ty; yz -= d * tz;
    const m = Math.hypot(yx, yy, yz) || 1; yx /= m; yy /= m; yz /= m;
    t[a] = tx; t[a + 1] = ty; t[a + 2] = tz; y[a] = yx; y[a + 1] = yy; y[a + 2] = yz;
    z[a] = ty * yz - tz * yy; z[a + 1] = tz * yx - tx * yz; z[a + 2] = tx * yy - ty * yx;
  }
}

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
    this.t = new Float32Array(3 * count); this.y = new Float32Array(3 * count); this.z = new Float32Array(3 * count);
    const total = count * this.P + 2 * n, first = count * this.P, last = first + n;
    const faces = (corners, rows) => {              // between some corners of the profile, at some points of the line
      const index = [], next = (k) => 2 * ((corners[(k + 1) % corners.length] + n - 1) % n) + 1;
      for (let r = 0; r + 1 < rows.length; r++) corners.forEach((e, k) => {
        const i = rows[r] * this.P, j = rows[r + 1] * this.P, [a, b, c, d] = [i + 2 * e, i + next(k), j + next(k), j + 2 * e];
        index.push(a, b, c, a, c, d);
      });
      for (const ends of THREE.ShapeUtils.triangulateShape(corners.map((e) => new THREE.Vector2(...o[e])), [])) {
        const [a, b, c] = ends.map((k) => corners[k]);
        index.push(first + a, first + c, first + b, last + a, last + b, last + c);
      }
      return index;
    };
    const corners = o.map((_, i) => i), rows = Array.from({length: count}, (_, i) => i), apart = Math.max(1, Math.floor(n / SIDES));
    const g = this.geometry = new THREE.BufferGeometry();
    g.setIndex(faces(corners, rows));
    lighter(g, faces(corners.filter((i) => i % apart === 0 || !soft(i)), rows.filter((i) => i % 2 === 0 || i === count - 1)));
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
    const {ring, P, count, position, normal, uv, outline, t, y, z} = this;
    sections(c, ys, ys.length === 3, count, t, y, z);
    let o = 0, u = 0;
    for (let i = 0; i < count; i++) {
      const a = 3 * i, tx = t[a], ty = t[a + 1], tz = t[a + 2], yx = y[a], yy = y[a + 1], yz = y[a + 2], zx = z[a], zy = z[a + 1], zz = z[a + 2];
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
