/* viewer.js: renderer, camera and light; draws when something has changed, and as sharply as there is time for. */
let viewer = null, soft = false;
const SLOW = 36, FAST = 22, REST = 12;             // [ms] a frame too long, and one with time to spare; frames without a change: at rest
const LEAST_RATIO = 0.3, RUN = 40;                 // pixels a pixel of the page in motion; frames with time to spare before more are drawn
const SHADES = 32;                                 // of the background, whose 8 bits have at most 30
class Viewer {
  constructor(pane) {
    const wish = new URLSearchParams(location.hash.slice(1)), sharp = Math.min(+wish.get("sharp") || 0, 4), still = sharp > 0 || wish.has("shots");
    soft = bySoftware();
    this.pane = pane;
    this.renderer = new THREE.WebGLRenderer({antialias: still || !soft});   // in software half of the time: there a picture at rest has four times the pixels
    this.renderer.autoClear = false;
    this.renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
    this.renderer.domElement.setAttribute("aria-hidden", "true");
    pane.append(this.renderer.domElement);
    const full = still ? sharp || 1 : soft ? 2 : Math.min(devicePixelRatio, 2);
    const ratios = [full];                         // at rest the first; in motion one of them, none finer than the screen
    while (!still && ratios.at(-1) * Math.SQRT1_2 > LEAST_RATIO) ratios.push(ratios.at(-1) * Math.SQRT1_2);
    Object.assign(this, {ratios, level: soft && !still ? ratios.findIndex((x) => x < 1) : 0, sharpest: Math.max(0, ratios.findIndex((x) => x < 1.01 * Math.max(1, devicePixelRatio))), gaps: [], patience: RUN, row: 0, began: 0, still: REST, asked: 0, size: [1, 1], recording: false, coarse: false});
    this.scene = new THREE.Scene();
    this.scene.fog = new THREE.Fog(0xf3f6fa, 1, 10);
    this.world = new THREE.Group();                // light, grid and ground of the run shown
    this.scene.add(this.world);
    this.camera = new THREE.PerspectiveCamera(FOV, 1, 0.01, 100);
    this.camera.up.set(0, 0, 1);
    this.controls = new THREE.OrbitControls(this.camera, this.renderer.domElement);
    this.controls.addEventListener("change", () => this.dirty());
  }
  resize() {
    const w = this.pane.clientWidth, h = this.pane.clientHeight;
    if (!w || !h) return;
    this.camera.aspect = w / h;
    this.camera.updateProjectionMatrix();
    this.renderer.setSize(w, h);
    this.size = [w, h];
    this.dirty();
  }
  dirty() { this.asked ||= requestAnimationFrame(() => this.move()); }
  /* Draw a change, which others may follow; sharply when none does. */
  move() {
    cancelAnimationFrame(this.asked);
    this.asked = 0;
    if (this.recording) return;                    // each picture of a film is asked for
    this.still = 0;
    this.draw(soft && this.busy ? this.ratios.length - 1 : this.level);
  }
  render() { this.draw(0); }                       // at once and sharp
  draw(level) {
    const ratio = this.ratios[level], coarse = ratio < 1 && level > 0;
    if (this.renderer.getPixelRatio() !== ratio) this.renderer.setPixelRatio(ratio);
    if (this.coarse !== coarse) this.scene.traverse(({geometry: g}) => { if (g?.userData.coarse) g.setIndex(coarse ? g.userData.coarse : g.userData.fine); });
    this.coarse = coarse;
    this.sky();
    this.renderer.render(this.scene, this.camera);
    turnCompass();
  }
  /* From haze to sky, a band for each shade: in software a textured background takes a third of the time. */
  sky() {
    const {renderer, tints: [low, high], size: [w, h]} = this, tint = low.clone();
    renderer.clear();
    renderer.setScissorTest(true);
    for (let i = 0; i < SHADES; i++) {
      renderer.setScissor(0, h * i / SHADES, w, h / SHADES + 1);
      renderer.setClearColor(tint.lerpColors(low, high, i / (SHADES - 1)));
      renderer.clear(true, false, false);
    }
    renderer.setScissorTest(false);
  }
  /* The browser begins a frame: how long those take that are drawn one after the other tells what there is time for. */
  begin(now) {
    const {gaps, ratios} = this, gap = now - this.began;
    this.row = this.still === 0 ? this.row + 1 : 0;
    this.began = now;
    if (++this.still === REST && this.renderer.getPixelRatio() < ratios[0]) this.render();
    if (this.busy || this.row < 3) return;
    gaps.push(gap);
    const middle = gaps.slice(-5).sort((a, b) => a - b)[2];
    if (gaps.length >= 5 && middle > SLOW) {
      if (this.level < ratios.length - 1) this.level++;
      else if (S.shadow && ratios.length > 1 && !this.plain) { this.plain = true; S.shadow = false; shade(); showControls(); }   // once: who wants them has them
      if (this.rose) this.patience = Math.min(2 * this.patience, 32 * RUN);   // it had been too much
      this.rose = false;
      gaps.length = 0;
    } else if (gaps.length >= this.patience) {
      this.rose = this.level > this.sharpest && gaps.reduce((a, b) => a + b) < FAST * gaps.length;
      if (this.rose) this.level--;
      gaps.length = 0;
    }
  }
}
function bySoftware() {                            // the name of what draws says so
  const gl = document.createElement("canvas").getContext("webgl2"), info = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = info ? String(gl.getParameter(info.UNMASKED_RENDERER_WEBGL)) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software/i.test(name);
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
  const shadow = new URLSearchParams(location.hash.slice(1)).get("shadow");   // still pictures ask for the best
  S.shadow = !soft;                                // software drawing: a third to a half slower with shadows
  viewer.renderer.shadowMap.enabled = shadow ? shadow === "1" : S.shadow;
  viewer.renderer.shadowMap.type = THREE.PCFShadowMap;
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
  ground.visible = viewer.renderer.shadowMap.enabled;   // else it is clear glass, drawn all the same
  world.add(new THREE.HemisphereLight(0xffffff, style("--bounce"), 0.56 * Math.PI * style("--sun")), sun, sun.target, grid, ground);
}
