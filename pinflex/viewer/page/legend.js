/* legend.js: the scale of the colours, and what the other marks are. */
function legendTicks() {                           // [value, text]: round numbers, and the end itself
  const top = legendMax(), low = scene.signed ? -top : 0, flat = getComputedStyle($("scale")).display === "block";
  const step = nice((top - low) / 4.5), apart = flat ? 0.17 : 17 / ($("scale").clientHeight || 180), ends = scene.signed ? [low, top] : [top], out = ends.map((v) => [v, minus(digits(v))]);
  for (let i = Math.ceil(low / step); i * step <= top * (1 + 1e-9); i++)
    if (ends.every((v) => Math.abs(v - i * step) > apart * (top - low))) out.push([i * step, minus(+(i * step).toPrecision(6))]);
  return out;
}
function setColours() {
  const fields = fieldsShown(), f = fields.find((x) => x.key === S.field) || fields[0];
  const options = fields.map((x) => x.key + x.label).join();
  if ($("field").dataset.options !== options) {
    $("field").dataset.options = options;
    $("field").replaceChildren(...fields.map((x) => el("option", {value: x.key}, x.label)));
  }
  $("legend-title").hidden = $("scale").hidden = !f;
  if (f) colourField(f);
  const keys = legendKeys(f);
  $("legend").hidden = !f && !keys.length;
  $("keys").replaceChildren(...keys.map(([k, text]) => el("div", {class: k ? "key " + k : ""}, text)));
}
function colourField(f) {
  S.field = f.key;
  $("field").value = f.key;
  scene.factor = R.mode ? 1 / (Math.abs(peakOf(f.key).value) || 1) : f.factor;
  scene.signed = peakOf(f.key).signed;
  const image = scene.lut.image.data, top = legendMax(), low = scene.signed ? -top : 0, full = fullMax();
  for (let i = 0; i < 1024; i++) image.set([...colourOf(full * (scene.signed ? (2 * i - 1023) / 1023 : i / 1023)), 255], 4 * i);
  scene.lut.needsUpdate = true;
  scene.coloured.emissiveIntensity = +style("--glow");
  const stops = Array.from({length: 65}, (_, i) => `rgb(${colourOf(low + (top - low) * i / 64).join(",")}) ${(i / 0.64).toFixed(1)}%`);
  $("bar").style.setProperty("--up", `linear-gradient(to top, ${stops})`);
  $("bar").style.setProperty("--right", `linear-gradient(to right, ${stops})`);
  $("bar").classList.toggle("off", !S.colours);
  $("unit").textContent = R.mode ? "relative" : `[${f.unit}]`;
  const ticks = legendTicks().map(([v, text]) => el("span", {style: `--u:${(v - low) / (top - low)}`}, text)), limit = limitShown();
  if (limit && limit < top) ticks.push(el("b", {style: `--u:${(limit - low) / (top - low)}`}));
  $("ticks").replaceChildren(...ticks);
}
function legendKeys(f) {
  const keys = [], limit = f && limitShown();
  if (f && (S.max > 0 || S.field === "utilisation") && legendMax() > 0 && Math.abs(legendMax() - fieldMax()) > 1e-3 * fieldMax()) keys.push([null, `run maximum ${digits(fieldMax())} ${f.unit}`]);
  if (limit) keys.push(["limit", S.field === "utilisation" ? `above yield${fieldMax() > 100 ? ": exceeded" : ""}` : `limit ${digits(S.limit)} ${f.unit}${fieldMax() > S.limit ? ", exceeded" : ""}`]);
  if (S.force && scene.forceMax) keys.push(["force", `joint force, longest ${digits(scene.forceMax)} N`]);
  if (S.torque && scene.torqueMax) keys.push(["torque", `motor torque, largest ${digits(scene.torqueMax)} N m`]);
  if (S.path !== "off" && scene.path) keys.push(["path", `path of ${R.track.name}${S.path === "magnified" ? `, ×${+S.mag.toPrecision(3)}` : ""}`]);
  if (S.ghost !== "off" && comparable() && !(otherRun() && S.ghost === "beside")) keys.push([otherRun() ? "other" : "ghost", R.mode ? "at rest" : otherRun() ? otherName() : "rigid mechanism"]);
  return keys;
}
