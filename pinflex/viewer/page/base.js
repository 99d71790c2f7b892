/* base.js: what the fixed frame is drawn by where the URDF draws nothing. */
/* Feet of the fixed frame: a flange under each joint, or a wall across a single clamped beam. */
function baseMarkers(b, run, size, material) {
  const out = [], r = Math.max(2.4 * b.radius, 0.02 * size), h = 0.35 * r;
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
