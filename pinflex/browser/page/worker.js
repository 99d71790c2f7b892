/* worker.js: the page's other thread. A message {id, settings} is answered in parts, each as soon as it
is known: torque, shape, stress (at first at some samples), error; a newer message stops the older one between them.
What takes longest waits until a slider has rested. */
const REST = 70, FREE = 0.5;                       // [ms]; time left to those that draw, of the time of an answer
let solvers = [], solver = null, wanted = null, busy = false, wake = null;
onmessage = async ({data}) => {
  if (data.wasm) {
    busy = true;
    try {
      const {header} = data;                       // of the same scene without and with the shaper of its motion
      const module = await WebAssembly.compile(data.wasm);
      for (const k of header.t.keys()) solvers.push(new Solver(await instantiated(module), Object.fromEntries(Object.entries(header).map(([name, x]) => [name, x[k]])), data.values));
      await answerTo({settings: {}}, () => {}).catch(() => {});   // unseen: what a browser runs first takes it four to eight times as long
      postMessage({ready: true});
    } catch (error) { postMessage({failed: String(error.message || error)}); }
    busy = false;
  } else { wanted = data; wake?.(); }
  if (busy || !solver) return;
  busy = true;
  while (wanted) {
    const now = wanted, began = performance.now();
    wanted = null; waited = 0;
    try { await answerTo(now); } catch (error) { postMessage({id: now.id, failed: String(error.message || error)}); }
    const took = performance.now() - began - waited;
    if (wanted && FREE * took > waited) await new Promise((next) => { setTimeout(next, FREE * took - waited); });
  }
  busy = false;
};
const breath = () => new Promise((next) => { const {port1, port2} = new MessageChannel(); port1.onmessage = next; port2.postMessage(0); });
let waited = 0;                                    // [ms] by an answer
/* Whether there is a newer message; up to some ms it is waited for. */
async function newer(ms = 0) {
  const from = performance.now();
  await breath();
  if (ms > 0 && !wanted) await new Promise((next) => { wake = next; setTimeout(next, ms); });
  waited += performance.now() - from;
  return wanted !== null;
}
const single = (x) => Float32Array.from(x);
/* Answers give their arrays away: none is copied, and none may be of the kernel or of use here. */
const give = (message) => postMessage(message, [...new Set(buffers(message))]);
const buffers = (x) => ArrayBuffer.isView(x) ? [x.buffer] : x && typeof x === "object" ? Object.values(x).flatMap(buffers) : [];

async function answerTo({id, settings}, post = give) {
  solver = solvers[settings.shaper >= 0.5 ? 1 : 0];
  const began = performance.now(), took = () => performance.now() - began - waited;
  const found = solver.states(settings), n = solver.t.length, {recovery, header} = solver, o = header.outputs, {once} = found;
  post({id, part: "torque", t: solver.t.slice(), torque: once.torque.slice(), steps: found.steps, took: took()});
  const poses = recovery.poses(n, once.y), still = solver.rigid(once, n), shapes = {}, bent = {}, bodies = {};
  for (const link of o.links) {
    bent[link.name] = recovery.bending(link, n, once.y);
    shapes[link.name] = shapeOf(recovery.shapes(link, n, bent[link.name], poses), still.shapes[link.name], n);
  }
  for (const [name, at] of Object.entries(o.bodies)) bodies[name] = difference(recovery.placed(poses, n, at), recovery.placed(still.poses, n, at));
  const track = o.platform && trackOf(recovery.placed(poses, n, o.platform), recovery.placed(still.poses, n, o.platform), n);
  post({id, part: "shape", links: shapes, bodies, track: track && {...track, position: track.position.slice(), deviation: track.deviation.slice()}, rigid: rigidOf(still, n), took: took()});
  if (await newer()) return;
  /* First at some samples, with straight lines between them; then at all. */
  const every = Math.max(1, Math.floor(n / FIRST_SAMPLES)), all = [...Array(n).keys()], some = all.filter((k) => k % every === 0 || k === n - 1);
  for (const which of every > 1 ? [some, all] : [all]) {
    const rough = which.length < n, stressed = stressesAt(which, found, bent, poses, still.poses);
    post({id, part: "stress", rough, ...(rough ? between(stressed, which, n) : stressed), took: took()});
    if (await newer(rough ? REST - took() : 0)) return;
  }
  found.twice = found.again();
  const error = errorOf(once, found.twice, bent, poses, track);
  if (await newer()) return;
  post({id, part: "error", error: {...error, stress: stressError(found, some)}, told: toldOf(settings), took: took()});
}
const FIRST_SAMPLES = 50;
let drawn = null;
/* The rigid robot, if it moves in another way than the one that was drawn last. */
function rigidOf(still, n) {
  if (drawn === null) drawn = solvers[0];
  if (drawn === solver) return null;
  drawn = solver;
  const {recovery, header: {outputs: o}} = solver, placed = (at) => recovery.placed(still.poses, n, at), single3 = (p) => Float32Array.from({length: 3 * n}, (_, i) => p[12 * Math.floor(i / 3) + 4 * (i % 3) + 3]);
  return {
    links: Object.fromEntries(o.links.map((link) => [link.name, single(still.shapes[link.name].line)])),
    bodies: Object.fromEntries(Object.entries(o.bodies).map(([name, at]) => [name, single(placed(at))])),
    joints: Object.fromEntries(Object.entries(o.joints).filter(([, node]) => recovery.row.has(node)).map(([name, node]) => [name, single3(still.poses.subarray(12 * n * recovery.row.get(node), 12 * n * (recovery.row.get(node) + 1)))])),
    track: o.platform && single3(placed(o.platform)),
  };
}
/* Stresses and section forces of links, and forces of joints, at some samples of a run. */
function stressesAt(which, found, bent, poses, still) {
  const {recovery, header} = solver, n = which.length, settled = solver.settled(found.once, found.steps, which), forces = recovery.forces(n, settled), fields = {}, sections = {}, full = solver.t.length;
  found.settled ??= settled;                       // at some samples, or at all if these are few
  for (const link of header.outputs.links) {
    const d = bent[link.name].map((x) => n === full ? x : rowsOf(x, x.length / full, which)), {stress, force} = recovery.strained(link, n, settled.y, d, forces);
    fields[link.name] = stress;
    sections[link.name] = Object.fromEntries(["N", "Vy", "Vz", "T", "My", "Mz"].map((k, c) => { const x = new Float32Array(force.length / 6); for (let i = 0; i < x.length; i++) x[i] = force[6 * i + c]; return [k, x]; }));
  }
  return {fields, sections, joints: jointForces(forces, poses, still, which)};
}
/* Arrays at some samples as arrays at all n, straight between: whatever the nesting. */
function between(x, which, n) {
  if (!ArrayBuffer.isView(x)) return Object.fromEntries(Object.entries(x).map(([k, y]) => [k, between(y, which, n)]));
  const width = x.length / which.length, out = new Float32Array(n * width);
  for (let k = 0, j = 0; k < n; k++) {
    while (j < which.length - 2 && which[j + 1] <= k) j++;
    const w = (k - which[j]) / (which[j + 1] - which[j]);
    for (let i = 0; i < width; i++) out[k * width + i] = (1 - w) * x[j * width + i] + w * x[(j + 1) * width + i];
  }
  return out;
}
function difference(a, b) {
  const out = new Float32Array(a.length);
  for (let i = 0; i < out.length; i++) out[i] = a[i] - b[i];
  return out;
}
/* Displacements from the rigid link, and the y axis of its sections, as viewer/links.py has them. */
function shapeOf(now, rigid, n) {
  const m = now.line.length / (3 * n), yRigid = new Float32Array(3 * n), yDisp = new Float32Array(3 * n * m), {line} = rigid, {normal} = now;
  for (let k = 0; k < n; k++) {
    const a = 3 * k * m, b = a + 3 * (m - 1), u = line[b] - line[a], v = line[b + 1] - line[a + 1], w = line[b + 2] - line[a + 2];
    const dot = (u * normal[a] + v * normal[a + 1] + w * normal[a + 2]) / (u * u + v * v + w * w || 1);
    const p = normal[a] - dot * u, q = normal[a + 1] - dot * v, r = normal[a + 2] - dot * w, size = Math.hypot(p, q, r) || 1;
    yRigid[3 * k] = p / size; yRigid[3 * k + 1] = q / size; yRigid[3 * k + 2] = r / size;
    for (let i = a; i <= b; i += 3) { yDisp[i] = normal[i] - p / size; yDisp[i + 1] = normal[i + 1] - q / size; yDisp[i + 2] = normal[i + 2] - r / size; }
  }
  return {disp: difference(now.line, line), y_rigid: yRigid, y_disp: yDisp};
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
/* Forces on what joints carry, in the world, and how far their origins are off, at some samples. */
function jointForces(forces, poses, still, which) {
  const out = {}, {recovery} = solver, all = recovery.nodes.length, full = solver.t.length, n = which.length;
  for (const [name, node] of Object.entries(solver.header.outputs.joints)) {
    const i = recovery.row.get(node);
    if (i === undefined) continue;
    const vector = new Float32Array(3 * n), disp = new Float32Array(3 * n);
    which.forEach((at, k) => {
      for (let r = 0; r < 3; r++) {
        const o = 12 * (i * full + at) + 4 * r, f = 6 * (k * all + i);
        vector[3 * k + r] = poses[o] * forces.f[f] + poses[o + 1] * forces.f[f + 1] + poses[o + 2] * forces.f[f + 2];
        disp[3 * k + r] = poses[o + 3] - still[o + 3];
      }
    });
    out[name] = {vector, disp};
  }
  return out;
}
/* What the second correction changes, over what it may see of the whole (solver/judge.py): torque; deflection,
of sections of links and of gears; and the platform, of how far it is off the rigid robot; stress, of each link's
own. Twice as much is told: of sixty runs the true error was up to 1.6 times the estimate (tests/benchmarks/live.py). */
const SAFE = 2, over = (apart, size) => size > 0 ? Math.max(SAFE * apart / size / solver.header.part, 1e-10) : 0;
function errorOf(once, twice, bent, poses, track) {
  const {recovery, header: {counts: {nq, nq_rigid}, outputs}} = solver, n = solver.t.length, again = recovery.poses(n, twice.y);
  const far = (pairs, from = 0, width = 1) => {
    let apart = 0, size = 0;
    for (const [a, b] of pairs) for (let i = 0; i < a.length; i++) if (i % width >= from) { apart = Math.max(apart, Math.abs(a[i] - b[i])); size = Math.max(size, Math.abs(b[i])); }
    return over(apart, size);
  };
  const of = (link, d, at) => recovery.deflections(link, n, d, at), gears = Math.max(0, ...outputs.links.flatMap((link) => link.pieces.map((p) => p.eta[1])));
  const bends = outputs.links.flatMap((link) => { const now = of(link, bent[link.name], poses), then = of(link, recovery.bending(link, n, twice.y), again); return now.map((a, j) => [a, then[j]]); });
  const error = {torque: far([[once.torque, twice.torque]]), deflection: far(bends)};
  if (nq_rigid + gears < nq) error["gear deflection"] = far([[once.y, twice.y]], nq_rigid + gears, nq);
  if (!track) return error;
  const pose = recovery.placed(again, n, outputs.platform);
  let apart = 0, size = 0;
  for (let k = 0; k < n; k++) {
    apart = Math.max(apart, Math.hypot(...[0, 1, 2].map((r) => pose[12 * k + 4 * r + 3] - track.position[3 * k + r])));
    size = Math.max(size, track.deviation[k]);
  }
  return {...error, platform: over(apart, size)};
}
function stressError({settled, twice, steps}, which) {
  const {recovery, header} = solver, n = which.length;
  const [a, b] = [settled, solver.settled(twice, steps, which)].map((s) => {
    const forces = recovery.forces(n, s);
    return header.outputs.links.map((link) => recovery.strained(link, n, s.y, recovery.bending(link, n, s.y), forces).stress.von_mises);
  });
  return Math.max(...b.map((y, link) => over(y.reduce((far, v, i) => Math.max(far, Math.abs(v - a[link][i])), 0), Math.max(...y))));
}
/* Largest error that tables between nodes have, of the sliders that are off theirs. */
function toldOf(settings) {
  return Math.max(0, ...solver.header.sliders.map((s) => s.change && settings[s.name] !== s.made ? s.change.error : 0));
}
