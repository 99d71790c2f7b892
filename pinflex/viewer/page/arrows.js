/* arrows.js: forces and torques in the drawing. */
/* Arrows start at joints, which lie inside of meshes: they are drawn over everything. */
const onTop = (name) => inTheme(phong(0xffffff, {depthTest: false, transparent: true}), name);
const lifted = (group) => group.children.forEach((mesh, i) => { mesh.renderOrder = 8 + i; });

function arrow(size, colour, root) {
  const material = onTop(colour), group = new THREE.Group();
  const shaft = new THREE.Mesh(new THREE.CylinderGeometry(1, 1, 1, 12), material);
  const head = new THREE.Mesh(new THREE.ConeGeometry(0.0085 * size, 0.03 * size, 16), material);
  group.add(shaft, head);
  lifted(group);
  group.visible = false;
  root.add(group);
  return (at, direction, length) => {               // direction is a unit vector; returns the tip, null if too short
    group.visible = length > 0.004 * size;
    if (!group.visible) return null;
    const body = Math.max(length - 0.03 * size, 0.001 * size);
    group.position.copy(at);
    group.quaternion.setFromUnitVectors(V(0, 1, 0), direction);
    shaft.scale.set(0.003 * size, body, 0.003 * size);
    shaft.position.y = body / 2;
    head.position.y = body + 0.015 * size;
    head.scale.setScalar(Math.min(1, length / (0.03 * size)));
    return at.clone().addScaledVector(direction, Math.max(length, body + 0.03 * size));
  };
}

function arc(size, root) {
  const n = 33, radius = 0.055 * size, group = new THREE.Group(), material = onTop("--torque");
  const sweep = new Sweep(circle(0.0038 * size, 8), n, material), head = new THREE.Mesh(new THREE.ConeGeometry(0.011 * size, 0.028 * size, 16), material);
  const c = new Float32Array(3 * n), e = V(), f = V(), p = V();
  group.add(sweep.mesh, head);
  lifted(group);
  group.visible = false;
  root.add(group);
  return {group, arc: (at, axis, share) => {        // share of the largest torque, signed
    group.visible = Math.abs(share) > 0.01;
    if (!group.visible) return null;
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
    return p.clone();
  }};
}


/* Joint forces and motor torques of a run, each with an arrow and the place of its value. */
function makeArrows(run, root) {
  const size = run.size, s = {};
  s.forceMax = Math.max(0, ...run.forces.map((f) => norms(f.vector)));
  s.forces = s.forceMax > 0 ? run.forces.map((f) => ({data: f, arrow: arrow(size, "--force", root)})) : [];
  s.torqueMax = Math.max(0, ...run.torques.map((f) => maxAbs(f.value)));
  s.torques = s.torqueMax > 0 ? run.torques.map((f) => ({data: f, ...(f.linear ? {arrow: arrow(size, "--torque", root)} : arc(size, root))})) : [];
  return s;
}
const norms = (v) => { let m = 0; for (let i = 0; i < v.length; i += 3) m = Math.max(m, Math.hypot(v[i], v[i + 1], v[i + 2])); return m; };

const spot = V(), way = V(), three = new Float32Array(3), threeRigid = new Float32Array(3);
function magnified({rigid, disp}, at, mag, out) {
  lerp(disp, 3, at, three); lerp(rigid, 3, at, threeRigid);
  return out.set(...[0, 1, 2].map((i) => threeRigid[i] + mag * three[i]));
}
function drawArrows(at) {
  for (const f of scene.forces) {
    lerp(f.data.vector, 3, at, three);
    way.set(...three);
    f.size = way.length();
    const n = S.force ? f.size : 0;
    f.tip = f.arrow(magnified(f.data, at, S.mag, spot), way.normalize(), 0.24 * scene.size * n / scene.forceMax);
  }
  for (const f of scene.torques) {
    lerp(f.data.vector, 3, at, three);
    way.set(...three).normalize();
    f.size = mixed(f.data.value, at);
    const share = S.torque ? f.size / scene.torqueMax : 0;
    magnified(f.data, at, S.mag, spot);
    f.tip = f.arc ? f.arc(spot, way, share) : f.arrow(spot, way.multiplyScalar(Math.sign(share) || 1), 0.24 * scene.size * Math.abs(share));
  }
}
