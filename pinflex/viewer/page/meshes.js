/* meshes.js: surfaces from the URDF, as they are on rigid links and bent with flexible ones. */

/* Corners of a packed mesh with normals that keep edges sharp: faces that meet at more than 40
   degrees do not share one. Equal corners are merged. */
function sharpened(mesh) {
  const n = mesh.points.length / 3, f = mesh.faces, m = f.length / 3, p = new Float32Array(3 * n);
  for (let i = 0; i < 3 * n; i++) p[i] = mesh.centre[i % 3] + mesh.half / 32767 * mesh.points[i];
  const normal = new Float32Array(3 * m), unit = new Float32Array(3 * m), first = new Int32Array(n + 1), around = new Int32Array(3 * m);
  for (let t = 0; t < m; t++) {
    const [a, b, c] = [3 * f[3 * t], 3 * f[3 * t + 1], 3 * f[3 * t + 2]];
    const ux = p[b] - p[a], uy = p[b + 1] - p[a + 1], uz = p[b + 2] - p[a + 2], vx = p[c] - p[a], vy = p[c + 1] - p[a + 1], vz = p[c + 2] - p[a + 2];
    const w = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx], l = Math.hypot(...w) || 1;
    for (let i = 0; i < 3; i++) { normal[3 * t + i] = w[i]; unit[3 * t + i] = w[i] / l; first[f[3 * t + i] + 1]++; }
  }
  for (let i = 0; i < n; i++) first[i + 1] += first[i];
  const next = first.slice();
  for (let k = 0; k < 3 * m; k++) around[next[f[k]]++] = Math.floor(k / 3);
  const position = [], normals = [], of = [], index = new Uint32Array(3 * m), known = new Map(), sharp = Math.cos(40 * Math.PI / 180);
  for (let k = 0; k < 3 * m; k++) {
    const t = 3 * Math.floor(k / 3), v = f[k], sum = [0, 0, 0];
    for (let j = first[v]; j < first[v + 1]; j++) {
      const o = 3 * around[j];                     // weighed by area
      if (unit[t] * unit[o] + unit[t + 1] * unit[o + 1] + unit[t + 2] * unit[o + 2] >= sharp) for (let i = 0; i < 3; i++) sum[i] += normal[o + i];
    }
    const l = Math.hypot(...sum) || 1, key = v + sum.map((x) => "," + Math.round(200 * x / l)).join("");
    let at = known.get(key);
    if (at === undefined) {
      at = position.length / 3;
      known.set(key, at);
      of.push(v);                                  // the point that this corner is a copy of
      position.push(p[3 * v], p[3 * v + 1], p[3 * v + 2]); normals.push(sum[0] / l, sum[1] / l, sum[2] / l);
    }
    index[k] = at;
  }
  return {position: Float32Array.from(position), normal: Float32Array.from(normals), of, index};
}

/* Fewer triangles: of the points in one cell of a grid all are the first, with the normal that is most alike. */
const CELLS = 14;                                  // along the longest side
function coarser({position, normal, of, index}) {
  const n = of.length, part = (i) => position.subarray(3 * i, 3 * i + 3), low = part(0).slice(), cells = new Map(), copies = {}, out = [];
  let most = 0;
  for (let i = 0; i < 3 * n; i++) low[i % 3] = Math.min(low[i % 3], position[i]);
  for (let i = 0; i < 3 * n; i++) most = Math.max(most, position[i] - low[i % 3]);
  of.forEach((point, i) => { (copies[point] ||= []).push(i); });
  const as = of.map((point, i) => {
    const key = part(i).map((x, c) => Math.floor(CELLS * (x - low[c]) / most)).join(), alike = (j) => [0, 1, 2].reduce((sum, c) => sum + normal[3 * i + c] * normal[3 * j + c], 0);
    if (!cells.has(key)) cells.set(key, point);
    return copies[cells.get(key)].reduce((a, b) => alike(b) > alike(a) ? b : a);
  });
  for (let k = 0; k < index.length; k += 3) {
    const three = [0, 1, 2].map((j) => as[index[k + j]]);
    if (new Set(three.map((i) => of[i])).size === 3) out.push(...three);
  }
  return out;
}

const made = {};                                   // several runs of a robot share their meshes
function once(kind, mesh, make) {
  const key = [kind, mesh.points.id, mesh.faces.id, mesh.centre, mesh.half].join();
  return made[key] || (made[key] = make());
}
const corners = (mesh) => once("corners", mesh, () => { const c = sharpened(mesh); return {...c, coarse: coarser(c)}; });
const meshGeometry = (mesh) => once("geometry", mesh, () => geometryOf(corners(mesh)));
function geometryOf(c) {
  const g = new THREE.BufferGeometry();
  g.setIndex(new THREE.BufferAttribute(c.index, 1));
  g.setAttribute("position", new THREE.BufferAttribute(c.position, 3));
  g.setAttribute("normal", new THREE.BufferAttribute(c.normal, 3));
  lighter(g, c.coarse);
  return g;
}

/* A mesh in beam coordinates carried by its centreline: every point moves with its own section. It
   takes the place of a Sweep. */
class Skin {
  constructor(base, stations, material) {
    const n = base.position.length / 3, m = stations.length;
    this.base = base; this.count = m;
    this.at = new Uint16Array(n); this.share = new Float32Array(n); this.over = new Float32Array(n);
    for (let i = 0; i < n; i++) {
      const x = clamp(base.position[3 * i], stations[0], stations[m - 1]);
      let k = 0;
      while (k < m - 2 && stations[k + 1] < x) k++;
      this.at[i] = k;
      this.share[i] = (x - stations[k]) / (stations[k + 1] - stations[k]);
      this.over[i] = base.position[3 * i] - x;     // beyond the ends it goes on straight
    }
    this.t = new Float32Array(3 * m); this.y = new Float32Array(3 * m); this.z = new Float32Array(3 * m);
    const g = this.geometry = new THREE.BufferGeometry();
    g.setIndex(new THREE.BufferAttribute(base.index, 1));
    lighter(g, base.coarse);
    for (const [k, size] of [["position", 3], ["normal", 3], ["uv", 2]]) {
      this[k] = new Float32Array(size * n);
      g.setAttribute(k, new THREE.BufferAttribute(this[k], size));
    }
    this.mesh = new THREE.Mesh(g, material);
    this.mesh.frustumCulled = false;
    g.boundingSphere = new THREE.Sphere(V(0, 0, 0), Infinity);   // it moves: a ray looks at every triangle
    this.mesh.castShadow = this.mesh.receiveShadow = true;
  }
  /* c: points (3 m); ys: wished y directions (3 m, or 3 for all); values: texture coordinates of the
     m stations, or own: of the points of the mesh */
  set(c, ys, values, own) {
    const {base, at, share, over, position, normal, uv, t, y, z} = this, one = ys.length === 3;
    sections(c, ys, one, this.count, t, y, z);
    const p = base.position, q = base.normal;
    for (let i = 0, n = at.length; i < n; i++) {
      const a = 3 * at[i], b = a + 3, w = share[i], v = 1 - w, o = over[i], r = 3 * i, py = p[r + 1], pz = p[r + 2];
      for (let j = 0; j < 3; j++) {
        const T = v * t[a + j] + w * t[b + j], Y = v * y[a + j] + w * y[b + j], Z = v * z[a + j] + w * z[b + j];
        position[r + j] = v * c[a + j] + w * c[b + j] + o * T + py * Y + pz * Z;
        normal[r + j] = q[r] * T + q[r + 1] * Y + q[r + 2] * Z;
      }
      uv[2 * i] = !values ? 0 : own ? values[base.of[i]] : v * values[at[i]] + w * values[at[i] + 1];
      uv[2 * i + 1] = 0.5;
    }
    for (const k of ["position", "normal", "uv"]) this.geometry.attributes[k].needsUpdate = true;
  }
}
