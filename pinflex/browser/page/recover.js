/* recover.js: from states to what is drawn, as pinflex.recovery has it: centrelines, section forces,
stresses, poses of bodies and of the platform, joint forces. Arrays are time first. */
class Recovery {
  constructor(heap, equations, array) {
    this.heap = heap;
    this.equations = equations;
    this.array = array;                             // by number, as the sliders have left it
    const o = this.o = heap.header.outputs, nodes = new Set(Object.values(o.joints));
    for (const link of o.links) for (const p of link.pieces) { nodes.add(p.root[0]); p.nodes.forEach((n) => nodes.add(n)); }
    for (const [n] of Object.values(o.bodies)) nodes.add(n);
    if (o.platform) nodes.add(o.platform[0]);
    this.nodes = [...nodes].filter((n) => n >= 0);
    this.row = new Map(this.nodes.map((n, i) => [n, i]));
    this.ready = new Map();
  }
  wanted() {
    const {heap} = this, at = heap.lend("wanted", this.nodes.length + 1);
    new BigInt64Array(heap.kernel.memory.buffer, at, this.nodes.length).set(this.nodes.map(BigInt));
    return at;
  }
  /* Poses [R | p] (n, 12) of every node wanted, in the order of `nodes`. */
  poses(n, y) {
    const k = this.nodes.length, given = this.equations.put("y", y), wanted = this.wanted(), out = this.equations.take("poses", k * n * 12);
    this.equations.call("poses", BigInt(n), given, BigInt(k), wanted, out);
    return this.heap.view(out, k * n * 12).slice();
  }
  /* Of something fixed to a node, (n, 12); node -1: the base. */
  placed(poses, n, [node, placement]) {
    const local = this.array(placement), out = new Float64Array(12 * n), i = this.row.get(node);
    const still = Float64Array.from([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]);
    for (let k = 0; k < n; k++) {
      const a = node < 0 ? still : poses.subarray(12 * (i * n + k), 12 * (i * n + k + 1)), o = 12 * k;
      for (let r = 0; r < 3; r++) {
        for (let c = 0; c < 4; c++) out[o + 4 * r + c] = a[4 * r] * local[c] + a[4 * r + 1] * local[4 + c] + a[4 * r + 2] * local[8 + c];
        out[o + 4 * r + 3] += a[4 * r + 3];
      }
    }
    return out;
  }
  /* Expanded forces g (n, nV), wrenches of the nodes (n, nodes, 6) and of the loops (n, loops, 6). */
  forces(n, s) {
    const {c} = this.equations, e = this.equations, k = this.nodes.length, wanted = this.wanted();
    const given = [e.put("y", s.y), e.put("v", s.v), e.put("a", s.a), e.put("lam", s.lam), e.ones(n)];
    const sizes = {r: n * c.nv, c: n * c.closures, g: n * c.nV, f: n * k * 6, loops: n * c.loops * 6, sleeves: n * c.sleeves * 24};
    const rooms = Object.entries(sizes).map(([name, size]) => e.take("force " + name, size));
    e.call("forces", BigInt(n), ...given, BigInt(k), wanted, ...rooms);
    const get = (j, size) => this.heap.view(rooms[j], size).slice();
    return {g: get(2, sizes.g), f: get(3, sizes.f), loops: get(4, sizes.loops)};
  }
  /* What a link's arrays come to at the present settings, for many poses: entries that are not zero, row by row. */
  prepared(p) {
    if (this.ready.has(p)) return this.ready.get(p);
    const get = (name) => p[name] === undefined ? null : this.array(p[name]), [from, to] = p.eta, m = to - from;
    const x = get("x"), nx = x.length, loadX = get("loads") || [];
    const where = Array.from(loadX, (v) => { let best = 0; for (let i = 1; i < nx; i++) if (Math.abs(x[i] - v) < Math.abs(x[best] - v)) best = i; return best; });
    const way = get("way"), width = way.length / (6 * nx);
    const made = {x, nx, m, from, where, loadX, outer: get("outer"), twist: get("outer_twist"), bodyPhi: get("body_Phi"), bodyX: get("body_x"),
      stations: get("stations"), twists: get("twists"), way: sparse(way, 6 * nx, width), width};
    this.ready.set(p, made);
    return made;
  }
  /* Of sections (n, nx, 6): displacements and angles in the frame of the body. */
  bent(p, n, y) {
    const {nq, nq_rigid} = this.equations.c, {nx, m, from, way: {row, at, value}, width} = this.prepared(p), rows = 6 * nx, d = new Float64Array(n * rows), term = new Float64Array(width);
    for (let k = 0; k < n; k++) {
      const e = k * nq + nq_rigid + from, o = k * rows;
      for (let i = 0; i < m; i++) term[i] = y[e + i];
      for (let i = 0, q = m; q < width; i++) for (let j = i; j < m; j++) term[q++] = term[i] * term[j];
      for (let r = 0; r < rows; r++) {
        let v = 0;
        for (let i = row[r], end = row[r + 1]; i < end; i++) v += value[i] * term[at[i]];
        d[o + r] = v;
      }
    }
    return d;
  }
  /* How far the sections (n, nx, 3) of each of a link's bodies are off the straight link, in the frame of its
  root (recovery/links.py): those of bodies beyond the first by where the one before takes them. */
  deflections(link, n, d, poses) {
    const roots = link.pieces.map((p) => this.placed(poses, n, p.root));
    return link.pieces.map((p, j) => {
      const {nx, x} = this.prepared(p), [offset] = this.array(p.offset), [R, first] = [roots[j], roots[0]], out = new Float64Array(3 * n * nx);
      for (let q = 0; q < n * nx; q++) {
        const of = d[j].subarray(6 * q, 6 * q + 3), o = 3 * q, e = 12 * Math.floor(q / nx), at = x[q % nx];
        if (!j) { out.set(of, o); continue; }
        const way = [0, 4, 8].map((r) => R[e + r] * (of[0] + at) + R[e + r + 1] * of[1] + R[e + r + 2] * of[2] + R[e + r + 3] - first[e + r + 3]);
        for (let c = 0; c < 3; c++) out[o + c] = first[e + c] * way[0] + first[e + 4 + c] * way[1] + first[e + 8 + c] * way[2] - (c ? 0 : offset + at);
      }
      return out;
    });
  }
  /* Centreline and y axis of the sections (n, nx, 3) in the world. */
  shape(p, n, d, poses) {
    const {nx, x} = this.prepared(p), root = this.placed(poses, n, p.root), line = new Float64Array(3 * n * nx), normal = new Float64Array(3 * n * nx);
    for (let k = 0; k < n; k++) {
      for (let i = 0; i < nx; i++) {
        const o = 6 * (k * nx + i), q = o >> 1, px = d[o] + x[i], py = d[o + 1], pz = d[o + 2], a = d[o + 3], b = d[o + 4], c = d[o + 5];
        /* the y axis of Rz(a) Ry(b) Rx(c) */
        const sa = Math.sin(a), ca = Math.cos(a), sc = Math.sin(c), cc = Math.cos(c), sb = Math.sin(b);
        const y0 = ca * sb * sc - sa * cc, y1 = sa * sb * sc + ca * cc, y2 = Math.cos(b) * sc;
        for (let r = 0; r < 3; r++) {
          const e = 12 * k + 4 * r;
          line[q + r] = root[e] * px + root[e + 1] * py + root[e + 2] * pz + root[e + 3];
          normal[q + r] = root[e] * y0 + root[e + 1] * y1 + root[e + 2] * y2;
        }
      }
    }
    return {line, normal};
  }
  /* Section forces (n, nx, 6) of one body of a link. */
  sections(p, n, y, d, forces) {
    const {nq, nq_rigid, nV} = this.equations.c, {nx, m, x, from, where, loadX, outer, twist, bodyPhi, bodyX, stations, twists} = this.prepared(p);
    const ns = bodyX.length, nt = twists ? twists.length : 0, all = this.nodes.length, nodes = p.nodes.map((node) => this.row.get(node));
    const loads = loadX.length, turning = nodes.length > loads;
    const force = new Float64Array(n * nx * 6), arm = new Float64Array(ns * 3), pull = new Float64Array(ns * 3), hung = forces.f, g = forces.g;
    for (let k = 0; k < n; k++) {
      const e = k * nq + nq_rigid + from, o = k * nV;
      for (let i = 0; i < ns; i++) {
        for (let c = 0; c < 3; c++) {
          const q = 3 * i + c;
          let v = c ? 0 : bodyX[i];
          for (let j = 0; j < m; j++) v += bodyPhi[q * m + j] * y[e + j];
          pull[q] = g[o + stations[q]];
          arm[q] = v;
        }
      }
      for (let i = 0; i < nx; i++) {
        let F0 = 0, F1 = 0, F2 = 0, M0 = 0, M1 = 0, M2 = 0;
        for (let j = 0; j < ns; j++) {
          const w = outer[i * ns + j];
          if (w === 0) continue;
          const q = 3 * j, a = arm[q], b = arm[q + 1], c = arm[q + 2], u = w * pull[q], v = w * pull[q + 1], z = w * pull[q + 2];
          F0 += u; F1 += v; F2 += z;
          M0 += b * z - c * v; M1 += c * u - a * z; M2 += a * v - b * u;
          if (turning) {
            const f = 6 * (k * all + nodes[loads + j]) + 3;
            M0 += w * hung[f]; M1 += w * hung[f + 1]; M2 += w * hung[f + 2];
          }
        }
        for (let j = 0; j < nt; j++) M0 += twist[i * nt + j] * g[o + twists[j]];
        const at = 6 * (k * nx + i);
        for (let l = 0; l < loads; l++) {
          if (!(x[i] <= loadX[l] * (1 + 1e-12))) continue;
          const q = 6 * (k * nx + where[l]), f = 6 * (k * all + nodes[l]), u = hung[f], v = hung[f + 1], z = hung[f + 2], a = d[q] + loadX[l], b = d[q + 1], c = d[q + 2];
          F0 += u; F1 += v; F2 += z;
          M0 += hung[f + 3] + b * z - c * v; M1 += hung[f + 4] + c * u - a * z; M2 += hung[f + 5] + a * v - b * u;
        }
        const px = d[at] + x[i], py = d[at + 1], pz = d[at + 2];
        force[at] = -F0; force[at + 1] = -F1; force[at + 2] = -F2;
        force[at + 3] = py * F2 - pz * F1 - M0; force[at + 4] = pz * F0 - px * F2 - M1; force[at + 5] = px * F1 - py * F0 - M2;
      }
    }
    return force;
  }
  /* Rows (n, kept) of `width` numbers of a link's bodies, at the stations that are drawn. */
  kept(link, n, found, width) {
    const sizes = link.pieces.map((p) => this.prepared(p).nx), {kept} = link;
    if (sizes.length === 1 && kept.length === sizes[0]) return found[0];
    const places = [], out = new Float64Array(n * kept.length * width);
    sizes.forEach((nx, j) => { for (let i = j ? 1 : 0; i < nx; i++) places.push([j, i]); });
    kept.forEach((at, i) => {
      const [j, from] = places[at], of = found[j], nx = sizes[j];
      for (let k = 0; k < n; k++) for (let c = 0; c < width; c++) out[(k * kept.length + i) * width + c] = of[(k * nx + from) * width + c];
    });
    return out;
  }
  /* How each of a link's bodies bends at poses y (n, nq). */
  bending(link, n, y) { return link.pieces.map((p) => this.bent(p, n, y)); }
  shapes(link, n, d, poses) {
    const found = link.pieces.map((p, j) => this.shape(p, n, d[j], poses));
    return {line: this.kept(link, n, found.map((x) => x.line), 3), normal: this.kept(link, n, found.map((x) => x.normal), 3)};
  }
  /* Section forces and stresses of a link at the stations that are drawn. */
  strained(link, n, y, d, forces) {
    const force = this.kept(link, n, link.pieces.map((p, j) => this.sections(p, n, y, d[j], forces)), 6);
    return {force, stress: this.stresses(link, force)};
  }
  stresses(link, force) {
    const [A, Iy, Iz, Wt] = this.array(link.section), fibres = this.array(link.fibres), all = fibres.length / 2, count = force.length / 6;
    let far = 0, rest = 0;
    const half = all >> 1;
    for (const v of fibres) far = Math.max(far, Math.abs(v));
    for (let i = 0; i < 2 * half; i++) rest = Math.max(rest, Math.abs(fibres[i] + fibres[fibres.length - 2 * half + i]));
    const opposite = 2 * half === all && rest < 1e-12 * far, used = opposite ? half : all;
    const out = Object.fromEntries(["axial", "bending", "normal", "shear", "von_mises"].map((name) => [name, new Float64Array(count)]));
    for (let k = 0; k < count; k++) {
      const o = 6 * k, axial = force[o] / A, my = force[o + 4] / Iy, mz = force[o + 5] / Iz;
      let most = 0, least = 0;
      for (let i = 0; i < used; i++) {
        const v = my * fibres[2 * i + 1] - mz * fibres[2 * i];
        if (v > most) most = v;
        if (v < least) least = v;
      }
      const bending = Math.max(most, -least);
      if (opposite) { most = bending; least = -bending; }
      const normal = Math.max(axial + most, -(axial + least)), shear = Math.abs(force[o + 3]) / Wt;
      out.axial[k] = axial; out.bending[k] = bending; out.normal[k] = normal; out.shear[k] = shear;
      out.von_mises[k] = Math.sqrt(normal * normal + 3 * shear * shear);
    }
    return out;
  }
}
/* The entries of `rows` rows of `width` that are not zero. */
function sparse(x, rows, width) {
  const row = new Int32Array(rows + 1), at = [], value = [];
  for (let r = 0; r < rows; r++) {
    for (let i = 0; i < width; i++) if (x[r * width + i] !== 0) { at.push(i); value.push(x[r * width + i]); }
    row[r + 1] = at.length;
  }
  return {row, at: Int32Array.from(at), value: Float64Array.from(value)};
}
