/* colours.js: fields, their largest values, and the colour of a value. */
/* Fields of the run shown, and those that follow from them: share of the yield strength, distance from another run. */
function fieldsShown() {
  const out = R.fields.slice(), has = (key) => scene.links.length && scene.links.every((b) => b.fields[key]);
  if (R.mode) return out;
  if (has("utilisation")) out.splice(1, 0, {key: "utilisation", label: "share of yield strength", unit: "%", factor: 100});
  for (const [key, unit] of SECTION) if (R.links.some((k) => k.sections[key])) out.push({key, label: MEANING[key], unit, factor: 1, section: true});
  const away = otherRun() && scene.links.length ? maxAway() : null;
  if (away !== null) out.push({key: "difference", label: `distance from ${otherName()}`, ...(away < 1e-5 ? {unit: "µm", factor: 1e6} : {unit: "mm", factor: 1e3})});
  return out;
}
const fieldOf = (key) => fieldsShown().find((f) => f.key === key);
const sourceOf = (key) => key === "utilisation" ? "von_mises" : key;   // whose points it has
function fieldValues(b, key) {
  if (key !== "difference") return b.fields[key];
  const run = otherRun(), twin = run && run.links.find((k) => k.name === b.data.name);
  if (!twin || twin === b.data) return null;
  b.away = b.away || {};
  if (!(S.other in b.away)) b.away[S.other] = distance(b.data, twin);
  return b.away[S.other];
}
function maxAway() {
  scene.away = scene.away || {};
  if (!(S.other in scene.away)) scene.away[S.other] = furthest();
  return scene.away[S.other];
}
function furthest() {
  const all = scene.links.map((b) => fieldValues(b, "difference"));
  return all.some((a) => a === null) ? null : Math.max(0, ...all.map(maxAbs));
}
function peakOf(key) {                             // largest magnitude of a field over the run, where and when
  const id = key === "difference" ? key + S.other : key;
  if (scene.peaks[id]) return scene.peaks[id];
  const best = {value: 0, link: null, frame: 0, signed: false};
  let low = 0, high = 0;
  scene.links.forEach((b) => {
    const f = fieldValues(b, key);
    if (f) for (let i = 0; i < f.length; i++) {
      const v = f[i];
      if (v < low) low = v; else if (v > high) high = v;
      if (Math.abs(v) > Math.abs(best.value)) Object.assign(best, {value: v, link: b, frame: Math.floor(i / f.shape[1])});
    }
  });
  best.signed = low < -1e-3 * Math.max(high, -low);
  return (scene.peaks[id] = best);
}
/* The share of yield is shown to 100 %, so that colours say how near the material is to it; other fields to the largest value. */
const fieldMax = () => Math.abs(peakOf(S.field).value) * scene.factor;
const legendMax = () => (S.max > 0 ? S.max : S.field === "utilisation" ? Math.max(100, fieldMax()) : fieldMax()) || 1;
const fullMax = () => Math.max(legendMax(), fieldMax());   // what the texture spans: more than the legend, if need be

function colourAt(u) {                             // u in 0..1 to [r, g, b]
  const hex = MAPS[scene.signed ? "signed" : S.map], n = hex.length / 6 - 1, x = clamp(u, 0, 1) * n, i = Math.min(Math.floor(x), n - 1);
  const part = (j, c) => parseInt(hex.substr(6 * j + 2 * c, 2), 16);
  return [0, 1, 2].map((c) => Math.round(part(i, c) * (1 - x + i) + part(i + 1, c) * (x - i)));
}
const isStress = () => /stress/.test((fieldOf(S.field) || {}).label || "") && !R.mode;
function limitShown() {                            // in the unit shown: 100 % of yield, or the stress limit
  if (S.field === "utilisation") return 100;
  return S.limit > 0 && isStress() ? S.limit : null;
}
function colourOf(v) {                             // v in the shown unit; beyond the legend the end colour stays
  const limit = limitShown();
  if (limit && Math.abs(v) > limit) return OVER;
  const top = legendMax(), low = scene.signed ? -top : 0;
  return colourAt((v - low) / (top - low));
}
