/* compass.js: which way the axes point, and how long a length is on the screen. */
const AXES = [["x", [1, 0, 0]], ["y", [0, 1, 0]], ["z", [0, 0, 1]]], ARM = 22, TRIAD = 64;   // [px]
let rulerAt = null;

function turnCompass() {
  const turn = new THREE.Quaternion().copy(viewer.camera.quaternion).invert(), key = turn.toArray().map((x) => x.toFixed(3)).join();
  if (key !== turnCompass.key) {
    turnCompass.key = key;
    const m = TRIAD / 2, ends = AXES.map(([name, v]) => ({name, p: V(...v).applyQuaternion(turn)})).sort((a, b) => a.p.z - b.p.z);
    /* Letters at the ends, the longest first; one that would cover another stands where the axes leave room. */
    const letters = [], across = (e) => V(e.p.x, e.p.y, 0);
    for (const e of ends.slice().sort((a, b) => across(b).length() - across(a).length())) {
      e.at = across(e).multiplyScalar(ARM).addScaledVector(across(e).normalize(), 8);
      if (letters.some((at) => at.distanceTo(e.at) < 13) || across(e).length() < 0.2) e.at = ends.reduce((sum, o) => sum.sub(across(o)), V(0, 0, 0)).normalize().multiplyScalar(11);
      letters.push(e.at);
    }
    $("triad").replaceChildren(el("svg", {viewBox: `0 0 ${TRIAD} ${TRIAD}`, width: TRIAD, height: TRIAD}, ...ends.map((e) => el("g", {class: "axis-" + e.name},
      el("line", {x1: m, y1: m, x2: m + ARM * e.p.x, y2: m - ARM * e.p.y}),
      el("text", {x: m + e.at.x, y: m - e.at.y + 4, "text-anchor": "middle"}, e.name)))));
  }
  const distance = viewer.camera.position.distanceTo(viewer.controls.target), pixel = 2 * distance * Math.tan(FOV * Math.PI / 360) / viewer.size[1];
  const length = nice(70 * pixel), wide = Math.round(length / pixel), text = length >= 1 ? `${+length.toPrecision(2)} m` : `${+(1e3 * length).toPrecision(2)} mm`;
  if (rulerAt === text + wide) return;
  rulerAt = text + wide;
  $("ruler").style.width = wide + "px";
  $("ruler").firstChild.textContent = text;
}
