/* worker.js: the page's other thread. A message {id, settings} is answered in parts, each as soon as it
is known: shape (torques, poses), stress, error; a newer message stops the older one between them. */
let solver = null, wanted = null, busy = false;
onmessage = async ({data}) => {
  if (data.wasm) {
    try {
      solver = new Solver(await instantiated(data.wasm), data.header, data.values);
      postMessage({ready: true});
    } catch (error) { postMessage({failed: String(error.message || error)}); }
    return;
  }
  wanted = data;
  if (busy) return;
  busy = true;
  while (wanted) {
    const now = wanted;
    wanted = null;
    try { await answerTo(now); } catch (error) { postMessage({id: now.id, failed: String(error.message || error)}); }
  }
  busy = false;
};
const breath = () => new Promise((next) => { const {port1, port2} = new MessageChannel(); port1.onmessage = next; port2.postMessage(0); });
const single = (x) => Float32Array.from(x);

async function answerTo({id, settings}) {
  const newer = async () => { await breath(); return wanted !== null; }, began = performance.now();
  const found = solver.states(settings), n = solver.t.length, {recovery, header} = solver, o = header.outputs, s = found.once;
  const poses = recovery.poses(n, s.y), rigidY = solver.rigid(s, n), still = recovery.poses(n, rigidY);
  const state = {...s, y: rigidY}, shapes = {};
  for (const link of o.links) shapes[link.name] = shapeOf(recovery.link(link, n, s, poses, null, link.kept), recovery.link(link, n, state, still, null, link.kept), n);
  const bodies = {};
  for (const [name, at] of Object.entries(o.bodies)) bodies[name] = difference(recovery.placed(poses, n, at), recovery.placed(still, n, at));
  const track = o.platform && trackOf(recovery.placed(poses, n, o.platform), recovery.placed(still, n, o.platform), n);
  postMessage({id, part: "shape", t: solver.t, torque: s.torque.slice(), links: shapes, bodies, track, steps: found.steps, took: performance.now() - began});
  if (await newer()) return;
  const settled = solver.settled(found), forces = recovery.forces(n, settled), fields = {}, sections = {};
  for (const link of o.links) {
    const {stress, force} = recovery.link(link, n, settled, poses, forces, link.kept);
    fields[link.name] = Object.fromEntries(Object.entries(stress).map(([k, x]) => [k, single(x)]));
    sections[link.name] = Object.fromEntries(["N", "Vy", "Vz", "T", "My", "Mz"].map((k, c) => [k, Float32Array.from({length: force.length / 6}, (_, i) => force[6 * i + c])]));
  }
  postMessage({id, part: "stress", fields, sections, joints: jointForces(forces, poses, still, n), took: performance.now() - began});
  if (await newer()) return;
  postMessage({id, part: "error", error: errorOf(s, found.again()), told: toldOf(settings), took: performance.now() - began});
}
function difference(a, b) { return Float32Array.from(a, (x, i) => x - b[i]); }
/* Displacements from the rigid link, and the y axis of its sections, as viewer/links.py has them. */
function shapeOf(now, rigid, n) {
  const m = now.line.length / (3 * n), yRigid = new Float32Array(3 * n), yDisp = new Float32Array(3 * n * m);
  for (let k = 0; k < n; k++) {
    const a = 3 * k * m, b = a + 3 * (m - 1), along = [0, 1, 2].map((c) => rigid.line[b + c] - rigid.line[a + c]), y = [0, 1, 2].map((c) => now.normal[a + c]);
    const l = Math.hypot(...along) || 1, dot = (along[0] * y[0] + along[1] * y[1] + along[2] * y[2]) / (l * l);
    const square = y.map((v, c) => v - dot * along[c]), size = Math.hypot(...square) || 1;
    for (let c = 0; c < 3; c++) {
      yRigid[3 * k + c] = square[c] / size;
      for (let i = 0; i < m; i++) yDisp[a + 3 * i + c] = now.normal[a + 3 * i + c] - square[c] / size;
    }
  }
  return {disp: difference(now.line, rigid.line), y_rigid: yRigid, y_disp: yDisp};
}
/* How far the platform is from the rigid one: its way, its size, its turn. */
function trackOf(now, rigid, n) {
  const disp = new Float32Array(3 * n), deviation = new Float32Array(n), angle = new Float32Array(n), position = new Float64Array(3 * n);
  for (let k = 0; k < n; k++) {
    const o = 12 * k;
    let sum = 0, x = 0, y = 0, z = 0;
    for (let c = 0; c < 3; c++) {
      position[3 * k + c] = now[o + 4 * c + 3];
      const d = now[o + 4 * c + 3] - rigid[o + 4 * c + 3];
      disp[3 * k + c] = d;
      sum += d * d;
      x += now[o + 8 + c] * rigid[o + 4 + c] - now[o + 4 + c] * rigid[o + 8 + c];   // of R R_rigid', its skew part
      y += now[o + c] * rigid[o + 8 + c] - now[o + 8 + c] * rigid[o + c];
      z += now[o + 4 + c] * rigid[o + c] - now[o + c] * rigid[o + 4 + c];
    }
    deviation[k] = Math.sqrt(sum);
    angle[k] = Math.asin(Math.min(1, 0.5 * Math.sqrt(x * x + y * y + z * z)));
  }
  return {disp, deviation, angle, position};
}
/* Forces on what joints carry, in the world, and how far their origins are off. */
function jointForces(forces, poses, still, n) {
  const out = {}, {recovery} = solver, all = recovery.nodes.length;
  for (const [name, node] of Object.entries(solver.header.outputs.joints)) {
    const i = recovery.row.get(node);
    if (i === undefined) continue;
    const vector = new Float32Array(3 * n), disp = new Float32Array(3 * n);
    for (let k = 0; k < n; k++) for (let r = 0; r < 3; r++) {
      const o = 12 * (i * n + k) + 4 * r, f = 6 * (k * all + i);
      vector[3 * k + r] = poses[o] * forces.f[f] + poses[o + 1] * forces.f[f + 1] + poses[o + 2] * forces.f[f + 2];
      disp[3 * k + r] = poses[o + 3] - still[o + 3];
    }
    out[name] = {vector, disp};
  }
  return out;
}
/* What the second correction changes, over what it may see of the whole (solver/judge.py): torque and deflection. */
function errorOf(once, twice) {
  const {nq, nq_rigid} = solver.header.counts, {part} = solver.header;
  const far = (a, b, from, width) => {
    let apart = 0, size = 0;
    for (let i = 0; i < a.length; i++) if (i % width >= from) { apart = Math.max(apart, Math.abs(a[i] - b[i])); size = Math.max(size, Math.abs(b[i])); }
    return size > 0 ? Math.max(apart / size / part, 1e-10) : 0;
  };
  return {torque: far(once.torque, twice.torque, 0, 1), deflection: far(once.y, twice.y, nq_rigid, nq)};
}
/* Largest error that tables between nodes have, of the sliders that are off theirs. */
function toldOf(settings) {
  return Math.max(0, ...solver.header.sliders.map((s) => s.change && settings[s.name] !== s.made ? s.change.error : 0));
}
