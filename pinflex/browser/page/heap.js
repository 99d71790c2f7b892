/* heap.js: the kernel with the arrays and structures of one scene in its memory.

A scene comes as a header and one line of numbers. header.arrays: [length, "f" | "i" | "k" (of
the page alone), where their values stand or -1 for room]; header.structures: {size, integers: [[at, value]],
numbers: [[at, value]], arrays: [[at, array]], structures: [[at, structure]], fields: {name: [at, kind]}}.
Whole numbers of the kernel are of 64 bits; pointers are of 32 here. */
class Heap {
  constructor(exports, header, values) {
    this.kernel = exports;
    this.header = header;
    this.top = exports.memory.buffer.byteLength;
    this.where = header.arrays.map(([n, kind]) => this.room(kind === "k" ? 0 : 8 * n));
    this.at = header.structures.map((s) => this.room(s.size));
    this.work = 0;
    this.fill(values);
    this.work = this.room(Number(exports.pinflex_work_size(this.at[header.tables])));
  }
  room(size) {                                     // at a multiple of 64 bytes
    const memory = this.kernel.memory, at = this.top, end = at + Math.ceil((size + 1) / 64) * 64;
    if (end > memory.buffer.byteLength) memory.grow(Math.ceil((end - memory.buffer.byteLength) / 65536));
    this.top = end;
    return at;
  }
  /* Arrays and structures as if nothing had run. */
  fill(values) {
    this.header.arrays.forEach(([n, kind, from], k) => {
      if (from < 0 || kind === "k") return;
      if (kind === "f") this.numbers(k).set(values.subarray(from, from + n));
      else this.integers(k).set(BigInt64Array.from({length: n}, (_, i) => BigInt(values[from + i])));
    });
    this.header.structures.forEach((s, k) => {
      const view = new DataView(this.kernel.memory.buffer, this.at[k], s.size);
      for (let i = 0; i < s.size; i++) view.setUint8(i, 0);
      for (const [at, x] of s.integers) view.setBigInt64(at, BigInt(x), true);
      for (const [at, x] of s.numbers) view.setFloat64(at, x ?? Infinity, true);
      for (const [at, j] of s.arrays) view.setUint32(at, this.where[j], true);
      for (const [at, j] of s.structures) view.setUint32(at, this.at[j], true);
    });
  }
  numbers(k, n) { return new Float64Array(this.kernel.memory.buffer, this.where[k], n ?? this.header.arrays[k][0]); }
  integers(k) { return new BigInt64Array(this.kernel.memory.buffer, this.where[k], this.header.arrays[k][0]); }
  view(address, n) { return new Float64Array(this.kernel.memory.buffer, address, n); }
  get(k, field) {
    const [at, kind] = this.header.structures[k].fields[field], view = new DataView(this.kernel.memory.buffer);
    return kind === "d" ? view.getFloat64(this.at[k] + at, true) : kind === "p" ? view.getUint32(this.at[k] + at, true) : Number(view.getBigInt64(this.at[k] + at, true));
  }
  set(k, field, x) {
    const [at, kind] = this.header.structures[k].fields[field], view = new DataView(this.kernel.memory.buffer);
    if (kind === "d") view.setFloat64(this.at[k] + at, x, true);
    else view.setBigInt64(this.at[k] + at, BigInt(x), true);
  }
  /* Room that calls share, by name: addresses stay, views do not survive growth of the memory. */
  lend(name, n) {
    this.lent = this.lent || {};
    if (!this.lent[name] || this.lent[name][1] < n) this.lent[name] = [this.room(8 * n), n];
    return this.lent[name][0];
  }
}

async function instantiated(module) {
  const clock = {clock_time_get: (id, precision, at) => { new DataView(kernel.memory.buffer).setBigUint64(at, BigInt(Math.round(1e6 * performance.now())), true); return 0; }};
  const kernel = (await WebAssembly.instantiate(module, {wasi_snapshot_preview1: clock})).exports;
  if (kernel._initialize) kernel._initialize();
  return kernel;
}
