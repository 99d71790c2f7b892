/* settle.js: what a pose and its rates leave to be solved for, as pinflex.integrators.corrector and
pinflex.levels.quasistatic have it: accelerations at samples inside steps, and the start in balance. */
/* The equations at states row by row. */
class Equations {
  constructor(heap) {
    this.heap = heap;
    this.c = heap.header.counts;
    this.free = Int32Array.from(this.c.free);
  }
  put(name, x) { const at = this.heap.lend("state " + name, x.length + 1); this.heap.view(at, x.length).set(x); return at; }
  take(name, n) { return this.heap.lend("found " + name, n + 1); }
  ones(n) { const x = new Float64Array(n * this.c.forces).fill(1); return this.put("scale", x); }
  call(name, ...rest) { const {heap} = this; return heap.kernel["pinflex_" + name](heap.at[heap.header.tables], heap.work, ...rest); }
  residuals(n, y, v, a, lam) {
    const {nv, closures} = this.c, given = [this.put("y", y), this.put("v", v), this.put("a", a), this.put("lam", lam), this.ones(n)];
    const r = this.take("r", n * nv), c = this.take("c", n * closures);
    this.call("residuals", BigInt(n), ...given, r, c);
    return [this.heap.view(r, n * nv).slice(), this.heap.view(c, n * closures).slice()];
  }
  tangent(y, v, a, lam) {
    const {nv, closures} = this.c, given = [this.put("y", y), this.put("v", v), this.put("a", a), this.put("lam", lam), this.ones(1)];
    const parts = ["M", "C", "K"].map((p) => this.take(p, nv * nv)), J = this.take("J", closures * nv);
    this.call("tangent", 1n, ...given, ...parts, J);
    return [...parts.map((p) => this.heap.view(p, nv * nv).slice()), this.heap.view(J, closures * nv).slice()];
  }
  /* Second time derivatives of the closures; which 1: first, 0: themselves. */
  closureMotion(n, y, v, a, which = 2) {
    const {closures} = this.c, given = [this.put("y", y), this.put("v", v), this.put("a", a)];
    const parts = [0, 1, 2].map((k) => this.take("closure" + k, n * closures));
    this.call("closure_motion", BigInt(n), ...given, ...parts);
    return this.heap.view(parts[which], n * closures).slice();
  }
  /* [[S, J'], [J, 0]] of free rows, factored with the scales of its rows. */
  saddle(S, J, free = this.free) {
    const {nv, closures} = this.c, n = free.length, size = n + closures, A = new Float64Array(size * size), scale = new Float64Array(size).fill(1);
    for (let i = 0; i < n; i++) scale[i] = 1 / Math.sqrt(Math.max(Math.abs(S[free[i] * nv + free[i]]), 1e-300));
    for (let j = 0; j < n; j++) for (let i = 0; i < n; i++) A[j * size + i] = S[free[i] * nv + free[j]] * scale[i] * scale[j];
    for (let k = 0; k < closures; k++) for (let i = 0; i < n; i++) A[(n + k) * size + i] = A[i * size + n + k] = J[k * nv + free[i]] * scale[i];
    return {lu: this.factored("saddle", A, size), scale, n, size};
  }
  /* LU (kernel/source/lu.c) of a matrix (n, n), column by column, until the next of that name; throws where it is singular. */
  factored(name, A, n) {
    const {heap} = this, lu = this.put(name, A), pivot = this.take(name, n);
    if (!heap.kernel.factors(lu, BigInt(n), pivot)) throw new Error("singular equations");
    return {lu, pivot, n};
  }
  /* Answers to right-hand sides b (., n), in place. */
  solved({lu, pivot, n}, b) {
    const {heap} = this, x = this.put("sides", b);
    for (let at = x, end = x + 8 * b.length; at < end; at += 8 * n) heap.kernel.solve(lu, BigInt(n), pivot, at);
    b.set(heap.view(x, b.length));
    return b;
  }
  answer({lu, scale, size}, b) {
    const scaled = () => { for (let k = 0; k < b.length; k += size) for (let i = 0; i < size; i++) b[k + i] *= scale[i]; };
    scaled();
    this.solved(lu, b);
    scaled();
    return b;
  }
}

/* Accelerations and multipliers that solve the equations at samples inside steps (integrators/corrector.py):
in place, away from jumps; as they were where one does not converge. h: mean length of the steps, s; span: of the run, s. */
function settle(equations, t, jumps, h, states, span) {
  const before = {a: states.a.slice(), lam: states.lam.slice()}, near = 1e-9 * span, away = [...t.keys()].filter((k) => jumps.every((x) => Math.abs(t[k] - x) > near)), blocks = Math.min(13, Math.ceil(away.length / 8));
  let faint = 0;
  for (const k of t.keys()) for (const i of equations.free) faint = Math.max(faint, 1e-6 * Math.abs(states.a[k * equations.c.nv + i]));
  for (let b = 0, from = 0; b < blocks; b++) {
    const size = Math.floor(away.length / blocks) + (b < away.length % blocks ? 1 : 0);
    if (!settleBlock(equations, states, away.slice(from, from + size), h, faint)) return Object.assign(states, before);
    from += size;
  }
}
function rowsOf(x, width, which) {
  const out = new Float64Array(which.length * width);
  which.forEach((k, i) => out.set(x.subarray(k * width, (k + 1) * width), i * width));
  return out;
}
function settleBlock(equations, states, block, h, faint) {
  const {nq, nv, closures} = equations.c, {free} = equations, n = free.length, middle = [block[block.length >> 1]];
  const [M, C, K, J] = equations.tangent(rowsOf(states.y, nq, middle), rowsOf(states.v, nv, middle), rowsOf(states.a, nv, middle), rowsOf(states.lam, closures, middle));
  const soft = new Float64Array(n * n), S = M.slice();
  for (let i = 0; i < n; i++) for (let j = 0; j < n; j++) {
    const at = free[i] * nv + free[j];
    S[at] += soft[i * n + j] = h / 7 * C[at] + h * h / 50 * K[at];
  }
  const matrix = equations.saddle(S, J), size = matrix.size, rows = block.length, moved = new Float64Array(rows * n), B = new Float64Array(size * rows);
  const y = rowsOf(states.y, nq, block), v = rowsOf(states.v, nv, block), a = rowsOf(states.a, nv, block), lam = rowsOf(states.lam, closures, block);
  let first = faint;
  for (let round = 0; round < 8; round++) {
    const [r] = equations.residuals(rows, y, v, a, lam), open = closures ? equations.closureMotion(rows, y, v, a) : [];
    let far = 0;
    for (let k = 0; k < rows; k++) {
      for (let i = 0; i < n; i++) {
        let x = -r[k * nv + free[i]];
        if (round) for (let j = 0, f = i * n, m = k * n; j < n; j++) x -= soft[f++] * moved[m++];
        B[k * size + i] = x;
      }
      for (let i = 0; i < closures; i++) B[k * size + n + i] = -open[k * closures + i];
    }
    equations.answer(matrix, B);
    for (let k = 0; k < rows; k++) {
      for (let i = 0; i < n; i++) { const x = B[k * size + i]; moved[k * n + i] += x; a[k * nv + free[i]] += x; far = Math.max(far, Math.abs(x)); }
      for (let i = 0; i < closures; i++) lam[k * closures + i] -= B[k * size + n + i];
    }
    first = Math.max(first, far);
    if (!(far <= 1e-6 * first)) continue;
    block.forEach((k, i) => { states.a.set(a.subarray(i * nv, (i + 1) * nv), k * nv); states.lam.set(lam.subarray(i * closures, (i + 1) * closures), k * closures); });
    return true;
  }
  const half = block.length + 1 >> 1;              // as numpy splits: other halves have other matrices
  return block.length > 1 && settleBlock(equations, states, block.slice(0, half), h, faint) && settleBlock(equations, states, block.slice(half), h, faint);
}

/* Accelerations, multipliers and torques just after a jump of the motors' accelerations, at samples on one
(integrators/problem.py): a step that ends there has those before. kicks: [time, acceleration of each motor]. */
function afterJumps(equations, t, kicks, span, states) {
  const {nq, nv, closures, rows, motors} = equations.c, {free} = equations, row = (name, width, k) => states[name].slice(k * width, (k + 1) * width);
  for (const [at, ...held] of kicks) t.forEach((x, k) => {
    if (Math.abs(x - at) > 1e-9 * span) return;
    const y = row("y", nq, k), v = row("v", nv, k), a = row("a", nv, k), lam = row("lam", closures, k);
    rows.forEach((i, m) => { a[i] = held[m]; });
    const [M, , , J] = equations.tangent(y, v, a, lam), matrix = equations.saddle(M, J), {n, size} = matrix;
    for (let round = 0; round < 2; round++) {       // linear: the second one for round-off
      const [r] = equations.residuals(1, y, v, a, lam), open = closures ? equations.closureMotion(1, y, v, a) : [], b = new Float64Array(size);
      free.forEach((i, j) => { b[j] = -r[i]; });
      open.forEach((c, i) => { b[n + i] = -c; });
      equations.answer(matrix, b);
      free.forEach((i, j) => { a[i] += b[j]; });
      lam.forEach((c, i) => { lam[i] = c - b[n + i]; });
    }
    const [r] = equations.residuals(1, y, v, a, lam);
    states.a.set(a, k * nv); states.lam.set(lam, k * closures); states.torque.set(rows.map((i) => r[i]), k * motors);
  });
}
