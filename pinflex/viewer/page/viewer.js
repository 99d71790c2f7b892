/* viewer.js: renderer, camera and light; draws when something has changed. */
let viewer = null, soft = false;
class Viewer {
  constructor(pane) {
    this.pane = pane;
    this.renderer = new THREE.WebGLRenderer({antialias: true});
    this.renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
    this.renderer.domElement.setAttribute("aria-hidden", "true");
    pane.append(this.renderer.domElement);
    this.scene = new THREE.Scene();
    this.scene.fog = new THREE.Fog(0xf3f6fa, 1, 10);
    this.world = new THREE.Group();                // light, grid and ground of the run shown
    this.scene.add(this.world);
    this.camera = new THREE.PerspectiveCamera(FOV, 1, 0.01, 100);
    this.camera.up.set(0, 0, 1);
    this.controls = new THREE.OrbitControls(this.camera, this.renderer.domElement);
    this.controls.addEventListener("change", () => this.dirty());
    this.waiting = false;
  }
  resize() {
    const w = this.pane.clientWidth, h = this.pane.clientHeight;
    if (!w || !h) return;
    this.camera.aspect = w / h;
    this.camera.updateProjectionMatrix();
    this.renderer.setSize(w, h);
    this.dirty();
  }
  dirty() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => this.render());
  }
  render() {
    this.waiting = false;
    this.renderer.render(this.scene, this.camera);
    turnCompass();
  }
}
const FOV = 32;                                    // [deg]

function makeViewer() {
  try { viewer = new Viewer($("pane")); } catch (e) { fail("This browser draws nothing in space: WebGL 2 is missing or switched off."); }
  new ResizeObserver(() => {
    viewer.resize();
    if (!R) return;
    if (!cameraMoved) fitCamera();
    setColours();
    viewer.render();                                // at once: a screenshot may be taken before the next frame
    place();
  }).observe($("stage"));
  new ResizeObserver(() => { if (R) drawPlots(); }).observe($("plots"));   // hidden ones have no size to be drawn in
  const gl = viewer.renderer.getContext(), info = gl.getExtension("WEBGL_debug_renderer_info");
  soft = /swiftshader|llvmpipe|software/i.test(info ? String(gl.getParameter(info.UNMASKED_RENDERER_WEBGL)) : "");
  const wish = new URLSearchParams(location.hash.slice(1)), shadow = wish.get("shadow");   // still pictures ask for the best
  S.shadow = !soft;                                // software drawing: a third to a half slower with shadows
  viewer.renderer.shadowMap.enabled = shadow ? shadow === "1" : S.shadow;
  viewer.renderer.shadowMap.type = THREE.PCFShadowMap;
  viewer.renderer.setPixelRatio(+wish.get("sharp") > 0 ? Math.min(+wish.get("sharp"), 4) : soft ? 1 : Math.min(devicePixelRatio, 2));
  viewer.controls.addEventListener("change", () => place());
  viewer.controls.addEventListener("start", () => { cameraMoved = true; pressed(null); });
  viewer.controls.addEventListener("end", writeHash);
}

function shade() {                                 // shadows on or off
  if (viewer.renderer.shadowMap.enabled === S.shadow) return;
  viewer.renderer.shadowMap.enabled = S.shadow;
  viewer.scene.traverse((x) => { for (const m of [x.material].flat()) if (m) m.needsUpdate = true; });
  relight();
  viewer.dirty();
}

/* Light, grid and ground about a robot; returns the width of a cell of the grid. */
let around = null;                                 // what relight needs of the run shown
function light(size, centre, floor) {
  around = {size, centre, floor};
  relight();
  return nice(size / 8);
}
function relight() {
  const {size, centre, floor} = around, world = viewer.world, cell = nice(size / 8), count = 2 * Math.ceil(3 * size / cell);
  const sun = new THREE.DirectionalLight(0xffffff, 0.42 * Math.PI * style("--sun")), d = V(0.3, -0.75, 1.3).normalize();
  for (const old of world.children.slice()) { old.dispose?.(); old.geometry?.dispose(); old.material?.dispose(); }
  world.clear();
  sun.position.copy(centre).addScaledVector(d, 3 * size);
  sun.target.position.copy(centre);
  if (viewer.renderer.shadowMap.enabled) {
    sun.castShadow = true;
    sun.shadow.mapSize.set(2048, 2048);
    const c = sun.shadow.camera;
    c.left = c.bottom = -1.1 * size; c.right = c.top = 1.1 * size; c.near = 0.5 * size; c.far = 6 * size;
    sun.shadow.radius = 4; sun.shadow.bias = -0.0006; sun.shadow.normalBias = 0.002 * size;
  }
  const grid = new THREE.GridHelper(count * cell, count, style("--grid"), style("--grid"));
  grid.rotateX(Math.PI / 2);
  grid.position.set(Math.round(centre.x / cell) * cell, Math.round(centre.y / cell) * cell, floor);
  grid.material.transparent = true; grid.material.opacity = 0.3; grid.material.depthWrite = false;
  const ground = new THREE.Mesh(new THREE.PlaneGeometry(8 * size, 8 * size), new THREE.ShadowMaterial({opacity: isDark() ? 0.4 : 0.16, fog: false}));
  ground.position.set(centre.x, centre.y, floor - 1e-4 * size);
  ground.receiveShadow = true;
  world.add(new THREE.HemisphereLight(0xffffff, style("--bounce"), 0.56 * Math.PI * style("--sun")), sun, sun.target, grid, ground);
}
