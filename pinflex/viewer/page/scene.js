/* scene.js: one run as drawn objects; made when it is first shown. */
const scenes = {};
function sceneOf(index) {
  return scenes[index] || (scenes[index] = makeScene(DATA.runs[index]));
}
function lutTexture() {
  const lut = new THREE.DataTexture(new Uint8Array(4 * 1024), 1024, 1, THREE.RGBAFormat);
  lut.magFilter = lut.minFilter = THREE.LinearFilter;
  return lut;
}
function makeScene(run) {
  const lut = lutTexture(), plain = phong(COLOUR.plain);
  const coloured = phong(0xffffff, {map: lut, emissive: 0xffffff, emissiveMap: lut, emissiveIntensity: 0.26});
  const paints = {}, paint = (kind) => paints[kind] || (paints[kind] = phong(COLOUR[kind]));
  const robot = makeRobot(run, coloured, paint), size = run.size, root = robot.root;
  const s = {...robot, robot, run, size, nt: run.t.length, lut, coloured, plain, peaks: {}, aside: V(0, 0, 0),
    notes: run.notes.concat(robot.notes), ...makePath(run, root), ...makeArrows(run, root)};
  const auto = run.scale, top = nice(Math.max(10 * auto, 10), true);
  s.steps = [0];
  for (let p = -1; p < 7; p++) for (const k of [1, 2, 5]) { const v = +(k * 10 ** p).toPrecision(1); if (v >= Math.min(1, auto / 10) && v <= top) s.steps.push(v); }
  if (run.mode) s.steps = [0, 0.1, 0.2, 0.5, 1, 2, 5].map((v) => v * auto);
  s.moves = s.links.length > 0 && run.largest > 0;
  root.visible = false;
  viewer.scene.add(root);
  return s;
}
