/* ghost.js: what the robot is compared with: itself were it rigid, or another run; pale, over it or beside it. */
const ghosts = {};
let ghost = null;
const otherRun = () => S.other === "rigid" ? null : DATA.runs[+S.other] || null;
const otherName = () => { const run = otherRun(); return run ? runLabel(run, +S.other) : "rigid"; };

function ghostOf(index) {
  if (ghosts[index]) return ghosts[index];
  const run = DATA.runs[index], pale = phong(COLOUR.ghost, {blending: THREE.CustomBlending, blendSrcAlpha: THREE.OneFactor,
    blendDstAlpha: THREE.OneMinusSrcAlphaFactor, opacity: 0.22, depthWrite: false});
  const solid = {}, paint = (kind) => solid[kind] || (solid[kind] = phong(COLOUR[kind]));
  const robot = makeRobot(run, pale, paint);
  robot.pale = pale;
  robot.root.traverse((mesh) => {                   // drawn before the robot, which then covers it
    if (!mesh.isMesh) return;
    mesh.castShadow = mesh.receiveShadow = false;
    mesh.renderOrder = -1;
    mesh.userData.solid = mesh.material;
  });
  viewer.scene.add(robot.root);
  return (ghosts[index] = robot);
}
function chooseGhost() {
  if (ghost) ghost.root.visible = false;
  ghost = S.ghost === "off" || !comparable() ? null : ghostOf(otherRun() ? +S.other : S.run);
  if (!ghost) return;
  ghost.pale.color.set(style(otherRun() ? "--ghost-other" : "--ghost"));
  const equal = S.ghost === "beside" && otherRun();  // another run beside this one is drawn as this one is
  ghost.root.traverse((mesh) => { if (mesh.isMesh) mesh.material = equal ? mesh.userData.solid : ghost.pale; });
}
const comparable = () => scene.moves || !!otherRun();
function drawGhost() {
  if (!ghost) return;
  const beside = S.ghost === "beside", other = otherRun(), T = ghost.run.t;
  ghost.root.visible = S.t <= T[T.length - 1] + 1e-9;  // a run that stopped earlier is no longer there
  ghost.root.position.copy(beside ? scene.aside : V(0, 0, 0));
  for (const mesh of ghost.besides) mesh.visible = beside;
  ghost.pale.opacity = beside ? 1 : (other ? 0.34 : 0.22) * (shown === "dark" ? 1.5 : 1);
  ghost.pale.depthWrite = beside;
  const at = instant(S.t, T);
  moveRobot(ghost, at, other ? S.mag : 0);
  if (other && beside) colourLinks(ghost.links, at);
  else for (const b of ghost.links) b.sweep.set(b.c, b.y);
}
