/* march.js: a run in the page, as pinflex.solver.judge has it: steps, each corrected twice.

The kernel takes a batch of steps (march.c), which are corrected once and once more (correct.c); the
first correction is answered, and what the second one changes is its error. */
const END = {FULL: 0, INPUTS: 1, START: 2, STUCK: 3, PAUSED: 4};
const PIECES = ["y", "v", "a", "lam", "torque"];

class March {
  constructor(heap) {
    this.heap = heap;
    const {counts: c, marches, weights} = heap.header;
    this.counts = c;
    this.widths = {y: c.nq, v: c.nv, a: c.nv, lam: c.closures, torque: c.motors, work: 2};
    this.marches = marches;
    this.weights = weights.map((k) => k && heap.where[k]);
  }
  field(k, name) { return this.heap.get(this.marches[k], name); }
  put(k, name, x) { this.heap.set(this.marches[k], name, x); }
  array(k, name, n) { return this.heap.view(this.field(k, name), n); }
  step(k, name, row, width) { return this.heap.view(this.field(k, "steps." + name) + 8 * row * width, width); }

  /* States at the samples (sorted, in s) from a start, by the run corrected once; again(): twice. */
  run(samples, y, v) {
    const {heap, counts: c} = this, rows = samples.length, found = [this.room(rows), this.room(rows)];
    this.array(0, "y", c.nq).set(y);
    this.array(0, "v", c.nv).set(v);
    if (!heap.kernel.pinflex_begin(heap.at[heap.header.tables], heap.work, heap.at[this.marches[0]])) throw new Error("no unique start");
    for (const name of PIECES) for (const one of found) one[name].set(this.array(0, name, this.widths[name]), 0);
    let done = 1, ends = [null, null];               // accelerations at the end of the batch before
    const more = () => this.field(0, "stop") < this.field(0, "stops");
    while (more()) {
      const count = this.advance(), last = !more(), from = done;
      ends[0] = this.correct(1, count, ends[0]);
      done = this.sample(1, samples, from, count, found[0]);
      const again = () => { ends[1] = this.correct(2, count, ends[1]); this.sample(2, samples, from, count, found[1]); return found[1]; };
      if (last) return {once: found[0], again, steps: this.field(0, "number")};
      again();
    }
  }
  room(rows) {
    return Object.fromEntries([...PIECES, "work"].map((name) => [name, new Float64Array(rows * this.widths[name])]));
  }
  advance() {
    const {heap} = this, last = this.field(0, "count"), s = this.stages(0);
    if (last) for (const [name, n] of [["a", s * this.widths.a], ["lam", s * this.widths.lam], ["h", 1]])
      this.step(0, name, 0, n).set(this.step(0, name, last, n));
    this.put(0, "count", 0);
    for (;;) {
      const end = heap.kernel.pinflex_march(heap.at[heap.header.tables], heap.work, heap.at[this.marches[0]]);
      if (end === END.FULL) break;
      if (end !== END.PAUSED) throw new Error(end === END.STUCK ? `steps get shorter without end at t = ${this.field(0, "t").toPrecision(4)} s` : "no unique start");
    }
    const count = this.field(0, "count"), h = this.step(0, "h", count, 1)[0];
    this.put(0, "slow", Math.min(heap.header.slow, Math.sqrt(0.3 * h / this.span)));
    return count;
  }
  stages(k) { return this.heap.header.stages[k]; }
  /* Correct the steps of march k - 1; the accelerations at their end, from which the next ones go on. */
  correct(k, count, before) {
    const {heap} = this, n = this.widths.a, s = this.stages(k - 1);
    const end = before ? heap.lend("end" + k, n) : 0;
    if (before) heap.view(end, n).set(before);
    if (!heap.kernel.pinflex_correct_steps(heap.at[heap.header.tables], heap.work, heap.at[this.marches[k - 1]], heap.at[this.marches[k]], BigInt(count), this.weights[k], end, 0))
      throw new Error("steps cannot be corrected");
    return this.step(k - 1, "a", count, s * n).slice((s - 1) * n);
  }
  /* Read states off the corrected steps of march k; the number of samples there are then. */
  sample(k, samples, done, count, found) {
    const {heap} = this, at = [], of = [];
    for (let j = 1, i = done; j <= count; j++) {
      const end = this.step(k, "t", j, 1)[0] + (1 + 1e-9) * this.step(k, "h", j, 1)[0];
      for (; i < samples.length && samples[i] <= end; i++) { at.push(samples[i]); of.push(BigInt(j)); }
    }
    const n = at.length, names = [...PIECES, "work"];
    const rooms = names.map((name) => heap.lend("sample " + name, n * this.widths[name] + 1)), time = heap.lend("sample time", n + 1), which = heap.lend("sample of", n + 1);
    heap.view(time, n).set(at);
    new BigInt64Array(heap.kernel.memory.buffer, which, n).set(of);
    heap.kernel.pinflex_samples(heap.at[heap.header.tables], heap.at[this.marches[k]], BigInt(n), time, which, 0, ...rooms);
    names.forEach((name, j) => found[name].set(heap.view(rooms[j], n * this.widths[name]), done * this.widths[name]));
    return done + n;
  }
}
