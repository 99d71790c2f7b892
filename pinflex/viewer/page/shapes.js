/* shapes.js: the objects of one run, as three.js draws them. */
/* ---------------------------------------------------------------- geometry */
const V = (x, y, z) => new THREE.Vector3(x, y, z);
const phong = (color, more) => new THREE.MeshPhongMaterial({color, shininess: 28, specular: 0x1c1c1c, fog: false, ...more});

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

/* ---------------------------------------------------------------- one run as drawn objects */
function makeScene(run) {
  const size = run.size, nt = run.t.length, root = new THREE.Group(), soft = new THREE.Group();
  const s = {size, nt, root, soft, links: [], bodies: [], balls: [], besides: [], peaks: {}, notes: run.notes.slice()};
  const ghost = phong(COLOUR.ghost, {blending: THREE.CustomBlending, blendSrcAlpha: THREE.OneFactor, blendDstAlpha: THREE.OneMinusSrcAlphaFactor, opacity: 0.2, depthWrite: false});
  s.ghostMaterial = ghost;
  s.lut = new THREE.DataTexture(new Uint8Array(4 * 1024), 1024, 1, THREE.RGBAFormat);
  s.lut.magFilter = s.lut.minFilter = THREE.LinearFilter;
  const coloured = phong(0xffffff, {map: s.lut, emissive: 0xffffff, emissiveMap: s.lut, emissiveIntensity: 0.26}), plain = phong(COLOUR.plain);
  const least = 0.008 * size;
  let thin = null;
  for (const k of run.links) {
    const m = k.x.length, straight = k.rigid.shape[1] === 2;
    const extent = [0, 1].map((a) => Math.max(...k.outline.map((p) => p[a])) - Math.min(...k.outline.map((p) => p[a])));
    const grow = extent.map((e) => Math.max(1, least / Math.max(e, 1e-9)));
    if (Math.max(...grow) > 1.001 && !k.mesh) thin = Math.min(thin ?? Infinity, ...extent);
    const outline = k.outline.map((p) => [p[0] * grow[0], p[1] * grow[1]]);
    const skin = k.mesh && corners(k.mesh), base = straight ? [k.x[0], k.x[m - 1]] : k.x;
    const sweep = skin ? new Skin(skin, k.x, coloured) : new Sweep(outline, m, coloured);
    const shade = skin ? new Skin(skin, base, ghost) : new Sweep(outline, base.length, ghost);
    shade.mesh.castShadow = shade.mesh.receiveShadow = false;
    shade.mesh.renderOrder = -1;                    // before the robot, which then covers it: no tint on the colours
    root.add(sweep.mesh); soft.add(shade.mesh);
    const move = new Float32Array(nt * m);          // size of the displacement, a field as any other
    move.shape = [nt, m];
    for (let i = 0; i < nt * m; i++) move[i] = Math.hypot(k.disp[3 * i], k.disp[3 * i + 1], k.disp[3 * i + 2]);
    s.links.push({data: k, m, straight, sweep, shade, coloured, plain, share: Array.from(k.x, (x) => (x - k.x[0]) / (k.x[m - 1] - k.x[0])),
      fields: {...k.fields, displacement: move, ...k.surface}, onSurface: (key) => key in k.surface, c: new Float32Array(3 * m), r: new Float32Array(3 * m),
      rigid: new Float32Array(straight ? 6 : 3 * m), y: new Float32Array(3 * m), value: new Float32Array(m), now: new Float32Array(m),
      half: skin ? 0.7 * reach(skin.position) : Math.max(...outline.map((p) => Math.hypot(...p))), meshed: !!skin});
  }
  if (thin !== null) s.notes.push(`thin sections are drawn at least ${digits(1e3 * least, 2)} mm thick (true ${digits(1e3 * thin, 2)} mm)`);
  const ballGeometry = new THREE.SphereGeometry(1, 20, 14), jointMaterial = phong(COLOUR.joint);
  const poseAt = (b, k) => { const o = b.rigid.length > 12 ? 12 * k : 0; return Array.from(b.rigid.subarray(o, o + 12), (x, i) => x + (b.disp ? b.disp[o + i] : 0)); };
  const placeAt = (b, p, k) => { const m = poseAt(b, k); return V(...[0, 4, 8].map((r) => m[r] * p[0] + m[r + 1] * p[1] + m[r + 2] * p[2] + m[r + 3])); };
  const whens = [0, nt >> 1, nt - 1];               // what meets at all three belongs together
  const joints = run.bodies.filter((b) => !b.frame).flatMap((b) => b.points.map((p) => ({body: b, at: whens.map((k) => placeAt(b, p, k))})));
  const ends = run.links.flatMap((link) => [0, 1].map((e) => {
    const n = link.x.length, m = link.rigid.shape[1], vector = (a, count, k) => V().fromArray(a, 3 * (k * count + (e ? count - 1 : 0)));
    return {at: whens.map((k) => vector(link.rigid, m, k).add(vector(link.disp, n, k)))};
  }));
  const near = (p, q) => p !== q && p.at.every((v, i) => v.distanceTo(q.at[i]) < 0.01 * size);
  for (const b of run.bodies) {
    const material = phong(b.base ? COLOUR.base : b.platform ? COLOUR.platform : COLOUR.body);
    const group = new THREE.Group(), shade = new THREE.Group();
    group.matrixAutoUpdate = false;
    const add = (make) => {
      const mesh = make(material);
      mesh.castShadow = mesh.receiveShadow = true;
      group.add(mesh);
      const pale = make(ghost);
      pale.renderOrder = -1;
      shade.add(pale);
      if (b.base) s.besides.push(pale);             // it does not move: seen side by side only
    };
    for (const [p, q] of b.base ? [] : b.rods) add((m) => rod(p, q, b.radius, m));
    if (b.plate && !b.base) add((m) => plate(b.plate.outline, b.plate.normal, 0.9 * b.radius, m));
    const box = [];
    if (b.mesh) {
      const g = meshGeometry(b.mesh);
      add((m) => new THREE.Mesh(g, m));
      g.computeBoundingBox();
      const {min, max} = g.boundingBox;
      for (const x of [min.x, max.x]) for (const y of [min.y, max.y]) for (const z of [min.z, max.z]) box.push(V(x, y, z));
    }
    else if (b.base) for (const mesh of baseMarkers(b, run, size)) {
      const copy = mesh.clone();
      group.add(mesh); shade.add(copy); s.besides.push(copy);
    }
    root.add(group);
    shade.matrixAutoUpdate = false;
    soft.add(shade);
    if (b.mesh) { s.bodies.push({data: b, group, shade, box, matrix: new THREE.Matrix4()}); continue; }
    const lone = b.points.length === 1 && !b.base;  // on something else, which has its own ball
    const elsewhere = (j) => j.body === b && joints.concat(ends).some((o) => o.body !== b && near(o, j));
    for (const p of b.points) {
      if (b.frame || (b.base && b.walled) || (lone && joints.some(elsewhere))) continue;
      const ball = new THREE.Mesh(ballGeometry, jointMaterial);
      ball.scale.setScalar(Math.min(1.25 * b.radius, 0.018 * size) + (b.rods.length && b.radius > 0.014 * size ? b.radius - 0.014 * size : 0));
      ball.castShadow = true;
      root.add(ball);
      s.balls.push({ball, p: V(...p), body: s.bodies.length});
      const still = new THREE.Mesh(ballGeometry, ghost); // the same joint of the rigid robot, seen side by side
      still.position.set(...p);
      still.scale.copy(ball.scale);
      shade.add(still);
      s.besides.push(still);
    }
    s.bodies.push({data: b, group, shade, box, matrix: new THREE.Matrix4()});
  }
  for (const [n, k] of s.links.entries()) for (const e of [0, 1]) { // a ball where a link meets something; none at a free end
    if (k.meshed || !joints.concat(ends).some((o) => near(o, ends[2 * n + e]))) continue;
    const ball = new THREE.Mesh(ballGeometry, jointMaterial);
    ball.scale.setScalar(Math.max(0.0085 * size, 1.05 * Math.min(k.half, 0.012 * size)));
    ball.castShadow = true;
    root.add(ball);
    s.balls.push({ball, link: k, end: e});
  }
  if (run.track && maxAbs(run.track.deviation) + spread(run.track.rigid) > 1e-5 * size) {
    const over = (color) => new THREE.MeshBasicMaterial({color, fog: false, depthTest: false, transparent: true});
    const width = 0.0008 * size;                    // thin: magnified, a path winds through the robot and must not hide it
    s.path = new Sweep(circle(width, 6), nt, over(COLOUR.path));
    s.pathRigid = new Sweep(circle(0.65 * width, 6), nt, over(COLOUR.pathRigid));
    s.dot = new THREE.Mesh(ballGeometry, over(COLOUR.path));
    [s.pathRigid.mesh, s.path.mesh, s.dot].forEach((mesh, i) => { mesh.renderOrder = 5 + i; });   // seen through the platform
    s.dot.scale.setScalar(0.005 * size);
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
const reach = (p) => { let m = 0; for (let i = 0; i < p.length; i += 3) m = Math.max(m, Math.hypot(p[i + 1], p[i + 2])); return m; };
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
  const line = (radius, from, to) => {
    const c = new Float32Array([...from, ...to]), sweep = new Sweep(circle(radius, 6), 2, new THREE.MeshBasicMaterial({color: 0xb4bcc8, fog: false}));
    sweep.set(c, across(c));
    out.push(sweep.mesh);
  };
  for (const [p, q] of b.rails) line(0.004 * size, p, q);
  const points = b.points.map((p) => V(...p)), count = points.length;
  if (count > 1) {
    points.forEach((p) => flange(p, V(0, 0, 1)));
    for (let i = 0; i < (count > 2 ? count : 1); i++) line(0.0016 * size, b.points[i], b.points[(i + 1) % count]);
    return out;
  }
  const p = points.reduce((a, c) => (c.z < a.z ? c : a)), pose = b.rigid, at = V(pose[3], pose[7], pose[11]).add(p);
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

/* Arrows start at joints, which lie inside of meshes: they are drawn over everything. */
const onTop = (colour) => phong(colour, {depthTest: false, transparent: true});
const lifted = (group) => group.children.forEach((mesh, i) => { mesh.renderOrder = 8 + i; });

function arrow(size, colour, root) {
  const material = onTop(colour), group = new THREE.Group();
  const shaft = new THREE.Mesh(new THREE.CylinderGeometry(1, 1, 1, 12), material);
  const head = new THREE.Mesh(new THREE.ConeGeometry(0.011 * size, 0.03 * size, 16), material);
  group.add(shaft, head);
  lifted(group);
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
  const n = 33, radius = 0.055 * size, group = new THREE.Group(), material = onTop(COLOUR.torque);
  const sweep = new Sweep(circle(0.0038 * size, 8), n, material), head = new THREE.Mesh(new THREE.ConeGeometry(0.011 * size, 0.028 * size, 16), material);
  const c = new Float32Array(3 * n), e = V(), f = V(), p = V();
  group.add(sweep.mesh, head);
  lifted(group);
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

