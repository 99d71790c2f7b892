/* settle.js: what a pose and its rates leave to be solved for, as pinflex.integrators.corrector and
pinflex.levels.quasistatic have it: accelerations at samples inside steps, and the start in balance. */
/* LU with row pivots of a matrix (n, n), row by row, in place; throws where it is singular. */
function factored(A, n) {
  const pivot = new Int32Array(n);
  for (let k = 0; k < n; k++) {
    let p = k;
    for (let i = k + 1; i < n; i++) if (Math.abs(A[i * n + k]) > Math.abs(A[p * n + k])) p = i;
    if (!(Math.abs(A[p * n + k]) > 0)) throw new Error("singular equations");
    pivot[k] = p;
    if (p !== k) for (let j = 0; j < n; j++) { const x = A[k * n + j]; A[k * n + j] = A[p * n + j]; A[p * n + j] = x; }
    for (let i = k + 1; i < n; i++) {
      const f = A[i * n + k] /= A[k * n + k];
      if (f !== 0) for (let j = k + 1, a = i * n + j, b = k * n + j; j < n; j++) A[a++] -= f * A[b++];
    }
  }
  return {A, n, pivot};
}
function solved({A, n, pivot}, b) {
  for (let k = 0; k < n; k++) {
    const p = pivot[k], x = b[p];
    b[p] = b[k]; b[k] = x;
  }
  for (let i = 0; i < n; i++) { let x = b[i]; for (let j = 0, a = i * n; j < i; j++) x -= A[a++] * b[j]; b[i] = x; }
  for (let i = n - 1; i >= 0; i--) { let x = b[i]; for (let j = i + 1, a = i * n + j; j < n; j++) x -= A[a++] * b[j]; b[i] = x / A[i * n + i]; }
  return b;
}

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
    for (let i = 0; i < n; i++) for (let j = 0; j < n; j++) A[i * size + j] = S[free[i] * nv + free[j]] * scale[i] * scale[j];
    for (let k = 0; k < closures; k++) for (let i = 0; i < n; i++) A[(n + k) * size + i] = A[i * size + n + k] = J[k * nv + free[i]] * scale[i];
    return {lu: factored(A, size), scale, n, size};
  }
}
function answer({lu, scale, size}, b) {
  for (let i = 0; i < size; i++) b[i] *= scale[i];
  solved(lu, b);
  for (let i = 0; i < size; i++) b[i] *= scale[i];
  return b;
}
/* y -= f x of rows of B (., n) */
function less(B, n, y, x, f) { if (f !== 0) for (let k = 0, a = y * n, b = x * n; k < n; k++) B[a++] -= f * B[b++]; }
/* The same for n columns of B (size, n): sums that do not wait for one another. */
function answers({lu: {A, pivot}, scale, size}, B, n) {
  const scaled = () => { for (let i = 0; i < size; i++) for (let k = 0; k < n; k++) B[i * n + k] *= scale[i]; };
  scaled();
  for (let i = 0; i < size; i++) if (pivot[i] !== i) for (let k = 0; k < n; k++) { const x = B[i * n + k]; B[i * n + k] = B[pivot[i] * n + k]; B[pivot[i] * n + k] = x; }
  for (let i = 0; i < size; i++) for (let j = 0; j < i; j++) less(B, n, i, j, A[i * size + j]);
  for (let i = size - 1; i >= 0; i--) {
    for (let j = i + 1; j < size; j++) less(B, n, i, j, A[i * size + j]);
    for (let k = 0; k < n; k++) B[i * n + k] /= A[i * size + i];
  }
  scaled();
}

/* Accelerations and multipliers that solve the equations at samples inside steps (integrators/inside.py):
in place, away from jumps; h: mean length of the steps, s; span: of the run, s. */
function settle(equations, t, jumps, h, states, span) {
  const near = 1e-9 * span, away = [...t.keys()].filter((k) => jumps.every((x) => Math.abs(t[k] - x) > near)), blocks = Math.min(13, Math.ceil(away.length / 8));
  for (let b = 0, from = 0; b < blocks; b++) {
    const size = Math.floor(away.length / blocks) + (b < away.length % blocks ? 1 : 0);
    if (!settleBlock(equations, states, away.slice(from, from + size), h)) return false;
    from += size;
  }
  return true;
}
function rowsOf(x, width, which) {
  const out = new Float64Array(which.length * width);
  which.forEach((k, i) => out.set(x.subarray(k * width, (k + 1) * width), i * width));
  return out;
}
function settleBlock(equations, states, block, h) {
  const {nq, nv, closures} = equations.c, {free} = equations, n = free.length, middle = [block[block.length >> 1]];
  const [M, C, K, J] = equations.tangent(rowsOf(states.y, nq, middle), rowsOf(states.v, nv, middle), rowsOf(states.a, nv, middle), rowsOf(states.lam, closures, middle));
  const soft = new Float64Array(n * n), S = M.slice();
  for (let i = 0; i < n; i++) for (let j = 0; j < n; j++) {
    const at = free[i] * nv + free[j];
    S[at] += soft[i * n + j] = h / 7 * C[at] + h * h / 50 * K[at];
  }
  const matrix = equations.saddle(S, J), size = matrix.size, rows = block.length, moved = new Float64Array(rows * n), B = new Float64Array(size * rows);
  const y = rowsOf(states.y, nq, block), v = rowsOf(states.v, nv, block), a = rowsOf(states.a, nv, block), lam = rowsOf(states.lam, closures, block);
  let first = 0;
  for (let round = 0; round < 8; round++) {
    const [r] = equations.residuals(rows, y, v, a, lam), open = closures ? equations.closureMotion(rows, y, v, a) : [];
    let far = 0;
    for (let i = 0; i < n; i++) {
      for (let k = 0; k < rows; k++) B[i * rows + k] = -r[k * nv + free[i]];
      for (let j = 0; round && j < n; j++) { const f = soft[i * n + j]; if (f !== 0) for (let k = 0; k < rows; k++) B[i * rows + k] -= f * moved[j * rows + k]; }
    }
    for (let i = 0; i < closures; i++) for (let k = 0; k < rows; k++) B[(n + i) * rows + k] = -open[k * closures + i];
    answers(matrix, B, rows);
    for (let i = 0; i < n; i++) for (let k = 0; k < rows; k++) { const x = B[i * rows + k]; moved[i * rows + k] += x; a[k * nv + free[i]] += x; far = Math.max(far, Math.abs(x)); }
    for (let i = 0; i < closures; i++) for (let k = 0; k < rows; k++) lam[k * closures + i] -= B[(n + i) * rows + k];
    first = Math.max(first, far);
    if (!(far <= 1e-6 * first)) continue;
    block.forEach((k, i) => { states.a.set(a.subarray(i * nv, (i + 1) * nv), k * nv); states.lam.set(lam.subarray(i * closures, (i + 1) * closures), k * closures); });
    return true;
  }
  const half = block.length >> 1;
  return block.length > 1 && settleBlock(equations, states, block.slice(0, half), h) && settleBlock(equations, states, block.slice(half), h);
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
      answer(matrix, b);
      free.forEach((i, j) => { a[i] += b[j]; });
      lam.forEach((c, i) => { lam[i] = c - b[n + i]; });
    }
    const [r] = equations.residuals(1, y, v, a, lam);
    states.a.set(a, k * nv); states.lam.set(lam, k * closures); states.torque.set(rows.map((i) => r[i]), k * motors);
  });
}
