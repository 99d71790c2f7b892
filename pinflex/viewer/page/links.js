/* links.js: flexible links of one run, swept along their centrelines. */
const LEAST = 0.008;                               // of the robot's size: thinner sections would not be seen

function makeLinks(run, root, material, notes) {
  const size = run.size, nt = run.t.length, least = LEAST * size, out = [];
  let thin = null;
  for (const k of run.links) {
    const m = k.x.length;
    const extent = [0, 1].map((a) => Math.max(...k.outline.map((p) => p[a])) - Math.min(...k.outline.map((p) => p[a])));
    const grow = extent.map((e) => Math.max(1, least / Math.max(e, 1e-9)));
    if (Math.max(...grow) > 1.001 && !k.mesh) thin = Math.min(thin ?? Infinity, ...extent);
    const outline = k.outline.map((p) => [p[0] * grow[0], p[1] * grow[1]]);
    const skin = k.mesh && corners(k.mesh), sweep = skin ? new Skin(skin, k.x, material) : new Sweep(outline, m, material);
    root.add(sweep.mesh);
    out.push({data: k, m, straight: k.rigid.shape[1] === 2, sweep, fields: linkFields(k, nt), onSurface: (key) => key in k.surface,
      share: Array.from(k.x, (x) => (x - k.x[0]) / (k.x[m - 1] - k.x[0])), c: new Float32Array(3 * m), r: new Float32Array(3 * m),
      rigid: new Float32Array(3 * k.rigid.shape[1]), y: new Float32Array(3 * m), value: new Float32Array(m), now: new Float32Array(m),
      half: skin ? 0.7 * reach(skin.position) : Math.max(...outline.map((p) => Math.hypot(...p))), meshed: !!skin});
  }
  if (thin !== null) notes.push(`thin sections are drawn at least ${digits(1e3 * least, 2)} mm thick (true ${digits(1e3 * thin, 2)} mm)`);
  return out;
}
const reach = (p) => { let m = 0; for (let i = 0; i < p.length; i += 3) m = Math.max(m, Math.hypot(p[i + 1], p[i + 2])); return m; };

/* Fields of a link by key, (nt, n): those of the run, the size of the displacement, the share of the yield strength. */
function linkFields(k, nt) {
  const m = k.x.length, move = new Float32Array(nt * m), out = {...k.fields, ...k.surface, displacement: move};
  move.shape = [nt, m];
  for (let i = 0; i < nt * m; i++) move[i] = Math.hypot(k.disp[3 * i], k.disp[3 * i + 1], k.disp[3 * i + 2]);
  for (const [key] of SECTION) out[key] = k.sections[key] || NOTHING(nt, m);   // where it is nothing it is not kept
  if (k.strength > 0 && out.von_mises) {
    out.utilisation = out.von_mises.map((s) => 1e-6 * s / k.strength);
    out.utilisation.shape = out.von_mises.shape;
  }
  return out;
}

const NOTHING = (nt, m) => Object.assign(new Float32Array(nt * m), {shape: [nt, m]});

/* Distance of a link from itself in another run at the same instants and stations, (nt, n); null where these differ. */
function distance(k, other) {
  const m = k.x.length, rows = Math.min(k.disp.shape[0], other.disp.shape[0]);
  if (other.x.length !== m || k.x.some((x, i) => x !== other.x[i])) return null;
  const out = new Float32Array(k.disp.shape[0] * m);
  for (let i = 0; i < rows * m; i++) out[i] = Math.hypot(k.disp[3 * i] - other.disp[3 * i], k.disp[3 * i + 1] - other.disp[3 * i + 1], k.disp[3 * i + 2] - other.disp[3 * i + 2]);
  out.shape = [k.disp.shape[0], m];
  return out;
}
