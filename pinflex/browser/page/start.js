/* start.js: where a run starts, and the rigid mechanism at its motors' positions. */
const stagesOf = (heap) => heap.get(heap.header.marches[0], "stages");

/* y (+) move, and motors where they are told to be */
function retracted(heap, y, move) {
  const {nq, nv} = heap.header.counts, from = heap.lend("retract y", nq), way = heap.lend("retract move", nv), to = heap.lend("retract to", nq);
  heap.view(from, nq).set(y);
  heap.view(way, nv).set(move);
  heap.kernel.retract(heap.at[heap.header.tables], stagesOf(heap), from, way, to);
  return heap.view(to, nq).slice();
}
/* Closures (n, rows) and their Jacobians (n, rows, nv) at poses. */
function closures(equations, n, y) {
  const {nv, closures: rows} = equations.c, c = equations.take("c", n * rows), J = equations.take("Jn", n * rows * nv);
  equations.call("closures", BigInt(n), equations.put("y", y), c, J);
  return [equations.heap.view(c, n * rows).slice(), equations.heap.view(J, n * rows * nv).slice()];
}
/* The square part of a Jacobian (rows, nv) in the passive columns, factored. */
function passivePart(equations, J, passive) {
  const {nv} = equations.c, n = passive.length, A = new Float64Array(n * n);
  for (let j = 0; j < n; j++) for (let i = 0; i < n; i++) A[j * n + i] = J[i * nv + passive[j]];
  return equations.factored("passive", A, n);
}

/* Poses of the rigid mechanism where the motors of the poses Y (n, nq) are: links straight, loops closed. */
function rigidPoses(heap, equations, Y, n) {
  const {nq, nv, nq_rigid, closures: rows} = heap.header.counts, {passive} = heap.header, out = Float64Array.from(Y);
  for (let k = 0; k < n; k++) out.fill(0, k * nq + nq_rigid, (k + 1) * nq);
  if (!rows) return out;
  if (passive.length !== rows) throw new Error("loops that the passive joints do not close alone");
  for (let round = 0; round < 12; round++) {
    const [c, J] = closures(equations, n, out);
    let worst = 0;
    for (const x of c) worst = Math.max(worst, Math.abs(x));
    if (worst < 1e-13) return out;
    const move = new Float64Array(nv);
    for (let k = 0; k < n; k++) {
      const lu = passivePart(equations, J.subarray(k * rows * nv, (k + 1) * rows * nv), passive), step = equations.solved(lu, c.slice(k * rows, (k + 1) * rows));
      passive.forEach((i, j) => { move[i] = -step[j]; });
      out.set(retracted(heap, out.subarray(k * nq, (k + 1) * nq), move), k * nq);
    }
    if (worst < 1e-9) return out;                   // quadratic: the next one would be round-off
  }
  throw new Error("loops do not close");
}

/* The start in balance (levels/start.py): Newton from y, rates those of the rigid motion on bent links. */
function balanced(heap, equations, y, v, a) {
  const {nv, closures: rows} = equations.c, {passive} = heap.header, {free} = equations, n = free.length;
  const moving = rows > 0 && (v.some((x) => x) || a.some((x) => x));
  if (moving && passive.length !== rows) throw new Error("loops that the passive joints do not close alone");
  const rates = (at) => {
    const V = v.slice(), A = a.slice();
    if (!moving) return [V, A];
    const [, J] = closures(equations, 1, at), lu = passivePart(equations, J, passive);
    for (const [x, which] of [[V, 1], [A, 2]]) {
      const open = equations.closureMotion(1, at, V, which > 1 ? A : new Float64Array(nv), which);
      const step = equations.solved(lu, open);
      passive.forEach((i, j) => { x[i] -= step[j]; });
    }
    return [V, A];
  };
  let lam = new Float64Array(rows), previous = Infinity;
  for (let round = 0; round < 60; round++) {
    const [V, A] = rates(y), [r, c] = equations.residuals(1, y, V, A, lam), [, , K, J] = equations.tangent(y, V, A, lam);
    const matrix = equations.saddle(K, J), b = new Float64Array(n + rows), move = new Float64Array(nv);
    for (let i = 0; i < n; i++) b[i] = -r[free[i]];
    for (let k = 0; k < rows; k++) b[n + k] = -c[k];
    equations.answer(matrix, b);
    let turn = 0;
    for (let i = 0; i < n; i++) turn = Math.max(turn, Math.abs(b[i]));
    const factor = Math.min(1, 0.3 / Math.max(turn, 1e-300));
    for (let i = 0; i < n; i++) move[free[i]] = factor * b[i];
    lam = lam.map((x, k) => x - factor * b[n + k]);
    y = retracted(heap, y, move);
    if (!isFinite(turn)) break;
    if (turn < 1e-11 || (turn < 1e-8 && turn >= 0.5 * previous)) return [y, rates(y)[0]];
    previous = turn;
  }
  throw new Error("there is no static equilibrium near the start");
}
