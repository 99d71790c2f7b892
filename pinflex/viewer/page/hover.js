/* hover.js: the value under the pointer, and the link that a click opens. */
function nearest(x, y) {                           // the nearest drawn centreline, in pixels
  let best = null;
  for (const b of scene.links) {
    let p = project(b.c[0], b.c[1], b.c[2]).slice();
    const q0 = project(b.c[0], b.c[1], b.c[2] + b.half), far = Math.max(9, 1.3 * Math.hypot(q0[0] - p[0], q0[1] - p[1]));
    for (let i = 0; i + 1 < b.m; i++) {
      const q = project(b.c[3 * i + 3], b.c[3 * i + 4], b.c[3 * i + 5]).slice(), dx = q[0] - p[0], dy = q[1] - p[1];
      const u = clamp(((x - p[0]) * dx + (y - p[1]) * dy) / (dx * dx + dy * dy || 1), 0, 1);
      const d = Math.hypot(p[0] + u * dx - x, p[1] + u * dy - y);
      if (d < far && (!best || d < best.d)) best = {d, b, i, u};
      p = q;
    }
  }
  if (best && best.b.onSurface(sourceOf(S.field)) && (best.point = pointAt(best.b, x, y)) === null) return null;
  return best;
}
const within = (e) => { const box = $("stage").getBoundingClientRect(); return [e.clientX - box.left, e.clientY - box.top, box]; };
function hover(e) {
  const tip = $("tip"), [x, y, box] = within(e), free = e.target === viewer.renderer.domElement;
  const best = free && (e.buttons === 0 || e.pointerType === "touch") ? nearest(x, y) : null;
  viewer.renderer.domElement.style.cursor = best ? "pointer" : "";
  tip.hidden = !best;
  if (!best) return;
  const lines = describe(best.b, best.i, best.u, best.point);
  tip.replaceChildren(el("b", {}, lines[0]), ...lines.slice(1).map((s) => el("div", {}, s)));
  tip.style.left = clamp(x + 14, 4, box.width - tip.offsetWidth - 4) + "px";
  tip.style.top = clamp(y + 14, 4, box.height - tip.offsetHeight - 4) + "px";
}
let down = null;
function press(e) { down = [e.clientX, e.clientY]; }
function release(e) {                              // a click, not the end of a turn of the view
  if (!down || e.target !== viewer.renderer.domElement || Math.hypot(e.clientX - down[0], e.clientY - down[1]) > 4) return;
  const [x, y] = within(e), best = nearest(x, y);
  if (!best) return;
  const i = best.i + Math.round(best.u);
  set({link: best.b.data.name, at: +(best.b.share[i]).toPrecision(4)});
  $("tip").hidden = true;
}
const ray = new THREE.Raycaster();
function pointAt(b, x, y) {                        // of a link's own surface, the point nearest to where the pointer meets it
  ray.setFromCamera(new THREE.Vector2(2 * x / $("stage").clientWidth - 1, 1 - 2 * y / $("stage").clientHeight), viewer.camera);
  const {mesh, position, base} = b.sweep, hit = ray.intersectObject(mesh)[0];
  if (!hit) return null;
  const away = (i) => V().fromArray(position, 3 * i).distanceTo(hit.point);
  return base.of[[hit.face.a, hit.face.b, hit.face.c].sort((i, j) => away(i) - away(j))[0]];
}
function describe(b, i, u, point) {
  const mix = (a) => a[i] * (1 - u) + a[Math.min(i + 1, b.m - 1)] * u, at = instant(S.t), out = [b.data.name];
  out.push(`x = ${digits(1e3 * mix(b.data.x))} of ${digits(1e3 * b.data.length)} mm`);
  for (const f of fieldsShown()) {
    if (f.section && f.key !== S.field) continue;  // of section forces only the one shown
    const all = fieldValues(b, f.key), own = b.onSurface(sourceOf(f.key));
    if (!all || (own && point == null)) continue;  // it has no value on the centreline
    const values = lerp(all, all.shape[1], at, new Float32Array(all.shape[1])), v = own ? values[point] : mix(values);
    out.push(R.mode ? `${f.label} ${minus(digits(v / (Math.abs(peakOf(f.key).value) || 1)))} of largest` : `${f.label} ${minus(digits(v * f.factor))} ${f.unit}`);
  }
  return out;
}
