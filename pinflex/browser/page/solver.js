/* solver.js: a scene at the settings of its sliders: tables, start, run, settled samples, outputs. */
class Solver {
  constructor(kernel, header, values) {
    this.header = header;
    this.values = values;
    /* Equal arrays stand once in the file; a slider may change one of them. */
    const total = header.arrays.reduce((sum, [n, , from]) => sum + (from < 0 ? 0 : n), 0), line = new Float64Array(total);
    const {folded} = header;
    let at = 0;
    this.header.arrays = header.arrays.map(([n, kind, from], k) => {
      if (from < 0) return [n, kind, from];
      if (!folded || !folded.values.includes(k)) line.set(values.subarray(from, from + n), at);
      at += n;
      return [n, kind, at - n];
    });
    if (folded) this.unfold(folded, line);
    header.sliders.forEach(({change}) => change && this.uncode(change));
    this.base = line;
    this.now = line.slice();
    this.heap = new Heap(kernel, header, line);
    this.march = new March(this.heap);
    this.equations = new Equations(this.heap);
    this.recovery = new Recovery(this.heap, this.equations, (k) => this.array(k));
  }
  /* The table of the motion out of accelerations and beginnings of its pieces (recipe.py). */
  unfold({values, motors: m, ...numbers}, line) {
    const {start, a, once, twice} = Object.fromEntries(Object.entries(numbers).map(([name, k]) => [name, this.array(k, line)]));
    const n = Math.sqrt(once.length), half = this.array(this.header.names["0/in/half"], line), node = this.array(this.header.names["0/in/node"], line), tables = values.map((k) => this.array(k, line).fill(1)), {columns} = this.header.counts;
    half.forEach((h, p) => {
      for (let k = 0; k < n; k++) for (let i = 0; i < m; i++) {
        let v = 0, x = 0;
        for (let j = 0; j < n; j++) { const b = a[(p * n + j) * m + i]; v += once[k * n + j] * b; x += twice[k * n + j] * b; }
        const x0 = start[2 * p * m + i], v0 = start[(2 * p + 1) * m + i], row = columns * (p * n + k) + i;
        for (const to of tables) { to[row] = x0 + h * (node[k] + 1) * v0 + h * h * x; to[row + m] = v0 + h * v; to[row + 2 * m] = a[(p * n + k) * m + i]; }
      }
    });
  }
  array(k, of = this.now) { const [n, , from] = this.header.arrays[k]; return of.subarray(from, from + n); }
  named(name, of) { return this.array(this.header.names[name], of); }

  /* Tables at settings {slider: p}. */
  apply(settings) {
    this.now.set(this.base);
    this.recovery.ready.clear();
    const changes = this.header.sliders.filter((s) => s.change).map((s) => [settings[s.name] ?? s.value, s]);
    const order = {line: 0, polynomial: 0, factor: 1};
    changes.sort((a, b) => order[a[1].change.kind] - order[b[1].change.kind]);
    for (const [p, {change, made}] of changes) for (const [name, at, given] of change.arrays) {
      const to = this.named(name), n = at.length;
      if (change.kind === "factor") for (let i = 0; i < n; i++) to[at[i]] *= p / made;
      else if (change.kind === "line") for (let i = 0; i < n; i++) to[at[i]] += (p - made) * given[n + i];
      else {
        const x = this.turned(change, p, made);
        for (let i = 0; i < n; i++) to[at[i]] += given[i] % 2 ? -x[given[i] >> 1] : x[given[i] >> 1];
      }
    }
    this.stretch(1 / (settings.speed ?? 1));
  }
  /* What a slider does as the file has it (sliders.py): places by their differences, columns as whole numbers. */
  uncode(change) {
    const sums = (x) => { let sum = 0; return x.map((d) => sum += d); }, data = (x) => x && this.data(x);
    change.arrays = change.arrays.map(([name, entries, values]) => [name, sums(data(entries)), change.whole ? sums(data(values)) : data(values)]);
    if (!change.whole) return;
    const steps = data(change.steps).map((e) => 2 ** e);
    change.steps = steps;
    change.basis = data(change.basis);
    change.whole = data(change.whole).map((x, i) => { const z = x - 2 ** 52; return (z % 2 ? -(z + 1) / 2 : z / 2) * steps[i % steps.length]; });
  }
  /* By how much the columns at p differ from those that the tables were made at. */
  turned({nodes, basis, whole, steps}, p, made) {
    const [W, W0] = [weightsAt(nodes, p), weightsAt(nodes, made)], rank = basis.length / nodes.length, n = steps.length, x = new Float64Array(n);
    for (let k = 0; k < rank; k++) {
      let w = 0;
      nodes.forEach((_, i) => { w += (W[i] - W0[i]) * basis[i * rank + k]; });
      for (let j = 0; j < n; j++) x[j] += w * whole[k * n + j];
    }
    return x;
  }
  data([from, n]) { return this.values.subarray(from, from + n); }
  stretch(s) {
    this.s = s;
    const {columns, motors} = this.header.counts;
    for (let k = 0; k < 3; k++) {
      for (const name of ["in/end", "in/middle", "in/half", "in/corner", "stop_at"]) if (`${k}/${name}` in this.header.names) { const x = this.named(`${k}/${name}`); for (let i = 0; i < x.length; i++) x[i] *= s; }
      for (const name of ["in/value", "in/corner_value"]) if (`${k}/${name}` in this.header.names) {
        const x = this.named(`${k}/${name}`);
        for (let i = 0; i < x.length; i++) { const kind = Math.floor(i % columns / motors); if (kind === 1) x[i] /= s; else if (kind === 2) x[i] /= s * s; }
      }
    }
    this.heap.fill(this.now);
    for (let k = 0; k < 3; k++) {
      for (const name of ["h", "first", "shortest"]) this.march.put(k, name, s * this.march.field(k, name));
      const at = this.header.inputs[k];
      this.heap.set(at, "gap", s * this.heap.get(at, "gap"));
    }
    this.t = Float64Array.from(this.header.t, (t) => s * t);
    this.march.span = this.t[this.t.length - 1] - this.t[0];
    this.jumps = this.header.jumps.map((t) => s * t);
  }
  start() {
    const {nq, nv} = this.header.counts, y = this.named("0/y", this.base).slice(0, nq), rates = this.header.moving.map((x, k) => Float64Array.from(x, (r) => r / this.s ** (k + 1)));
    if (this.header.static) return balanced(this.heap, this.equations, y, ...rates);
    return [y, Float64Array.from(this.named("0/v", this.base).slice(0, nv), (x) => x / this.s)];
  }
  /* States at the samples; again() tells their error afterwards. */
  states(settings) {
    this.apply(settings);
    const [y, v] = this.start(), {once, again, steps} = this.march.run(this.t, y, v);
    const kicks = this.header.kicks.map(([at, ...held]) => [this.s * at, ...held.map((a) => a / this.s ** 2)]);
    const after = (states) => { afterJumps(this.equations, this.t, kicks, this.march.span, states); return states; };
    return {once: after(once), again: () => after(again()), steps};
  }
  /* Some of the samples (indices) of a run, with what a pose and its rates leave to be solved for. */
  settled(of, steps, which) {
    const {nq, nv, closures, motors} = this.header.counts, h = this.march.span / Math.max(steps, 1), pick = (name, width) => rowsOf(of[name], width, which);
    const some = {y: pick("y", nq), v: pick("v", nv), a: pick("a", nv), lam: pick("lam", closures), torque: pick("torque", motors)};
    settle(this.equations, Float64Array.from(which, (k) => this.t[k]), this.jumps, h, some, this.march.span);
    return some;
  }
  /* The rigid robot at the samples, the same at any speed and whatever the links: poses, bodies, links. */
  rigid(s, n) {
    if (this.still) return this.still;
    const {recovery} = this, {links} = this.header.outputs, y = rigidPoses(this.heap, this.equations, s.y, n), poses = recovery.poses(n, y);
    const shapes = Object.fromEntries(links.map((link) => [link.name, recovery.shapes(link, n, recovery.bending(link, n, y), poses)]));
    return this.still = {y, poses, shapes};
  }
}
/* Barycentric weights at x of a polynomial through Chebyshev points of the second kind. */
function weightsAt(nodes, x) {
  const hit = nodes.indexOf(x), n = nodes.length, w = new Float64Array(n);
  if (hit >= 0) { w[hit] = 1; return w; }
  let sum = 0;
  for (let k = 0; k < n; k++) sum += w[k] = (k % 2 ? -1 : 1) * (k === 0 || k === n - 1 ? 0.5 : 1) / (x - nodes[k]);
  return w.map((v) => v / sum);
}
