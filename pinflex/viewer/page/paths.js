/* paths.js: the way of the platform, thin, at true scale or magnified as the robot is. */
function makePath(run, root) {
  if (!run.track || maxAbs(run.track.deviation) + spread(run.track.rigid) <= 1e-5 * run.size) return {};
  const size = run.size, nt = run.t.length, over = (name) => inTheme(new THREE.MeshBasicMaterial({fog: false, depthTest: false, transparent: true}), name);
  const width = 0.0009 * size, path = new Sweep(circle(1.1 * width, 3), nt, over("--path")), pathRigid = new Sweep(circle(0.72 * width, 3), nt, over("--path-rigid"));
  const dot = new THREE.Mesh(ballGeometry, over("--path")), pathGroup = new THREE.Group();
  [pathRigid.mesh, path.mesh, dot].forEach((mesh, i) => { mesh.renderOrder = 5 + i; });   // seen through the platform
  dot.scale.setScalar(0.005 * size);
  pathRigid.set(run.track.rigid, across(run.track.rigid));
  pathGroup.add(path.mesh, pathRigid.mesh, dot);
  for (const mesh of [path.mesh, pathRigid.mesh]) mesh.castShadow = false;
  root.add(pathGroup);
  return {path, pathRigid, dot, pathGroup};
}
function spread(c) {
  let m = 0;
  for (let i = 3; i < c.length; i++) m = Math.max(m, Math.abs(c[i] - c[i % 3]));
  return m;
}
const pathMag = () => S.path === "magnified" ? S.mag : 1;
function drawPath() {
  if (!scene.path) return;
  const {disp, rigid} = R.track, mag = pathMag(), c = new Float32Array(rigid.length);
  for (let i = 0; i < c.length; i++) c[i] = rigid[i] + mag * disp[i];
  scene.path.set(c, across(c));
}
function drawDot(at) {
  if (!scene.path) return;
  scene.pathGroup.visible = S.path !== "off";
  magnified(R.track, at, pathMag(), scene.dot.position);
}
