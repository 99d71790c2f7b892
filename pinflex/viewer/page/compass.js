/* compass.js: which way the axes point, and how long a length is on the screen. */
const AXES = [["x", [1, 0, 0]], ["y", [0, 1, 0]], ["z", [0, 0, 1]]], ARM = 22, TRIAD = 64;   // [px]
let rulerAt = null;

function turnCompass() {
  const turn = new THREE.Quaternion().copy(viewer.camera.quaternion).invert(), key = turn.toArray().map((x) => x.toFixed(3)).join();
  if (key !== turnCompass.key) {
    turnCompass.key = key;
    const m = TRIAD / 2, ends = AXES.map(([name, v]) => ({name, p: V(...v).applyQuaternion(turn)})).sort((a, b) => a.p.z - b.p.z);
    $("triad").replaceChildren(el("svg", {viewBox: `0 0 ${TRIAD} ${TRIAD}`, width: TRIAD, height: TRIAD}, ...ends.map(({name, p}) => el("g", {class: "axis-" + name},
      el("line", {x1: m, y1: m, x2: m + ARM * p.x, y2: m - ARM * p.y}),
      el("text", {x: m + (ARM + 8) * p.x, y: m - (ARM + 8) * p.y + 4, "text-anchor": "middle"}, name)))));
  }
  const distance = viewer.camera.position.distanceTo(viewer.controls.target), pixel = 2 * distance * Math.tan(FOV * Math.PI / 360) / viewer.size[1];
  const length = nice(70 * pixel), wide = Math.round(length / pixel), text = length >= 1 ? `${+length.toPrecision(2)} m` : `${+(1e3 * length).toPrecision(2)} mm`;
  if (rulerAt === text + wide) return;
  rulerAt = text + wide;
  $("ruler").style.width = wide + "px";
  $("ruler").firstChild.textContent = text;
}
