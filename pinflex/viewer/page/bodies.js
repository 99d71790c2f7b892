/* bodies.js: rigid links of one run: rods, plates, meshes, and balls at joints. */
const ballGeometry = new THREE.SphereGeometry(1, 20, 14);
lighter(ballGeometry, Array.from({length: 70}, (_, k) => {   // every other row and column
  const a = 42 * Math.floor(k / 10) + 2 * (k % 10), [b, c, d] = [a + 2, a + 42, a + 44];
  return [b, a, d, a, c, d];
}).flat());

/* Where the joints of bodies and the ends of links are at three instants: what meets at all belongs together. */
function meetings(run) {
  const nt = run.t.length, whens = [0, nt >> 1, nt - 1];
  const poseAt = (b, k) => { const o = b.rigid.length > 12 ? 12 * k : 0; return Array.from(b.rigid.subarray(o, o + 12), (x, i) => x + (b.disp ? b.disp[o + i] : 0)); };
  const placeAt = (b, p, k) => { const m = poseAt(b, k); return V(...[0, 4, 8].map((r) => m[r] * p[0] + m[r + 1] * p[1] + m[r + 2] * p[2] + m[r + 3])); };
  const joints = run.bodies.filter((b) => !b.frame).flatMap((b) => b.points.map((p) => ({body: b, at: whens.map((k) => placeAt(b, p, k))})));
  const ends = run.links.flatMap((link) => [0, 1].map((e) => {
    const n = link.x.length, m = link.rigid.shape[1], vector = (a, count, k) => V().fromArray(a, 3 * (k * count + (e ? count - 1 : 0)));
    return {at: whens.map((k) => vector(link.rigid, m, k).add(vector(link.disp, n, k)))};
  }));
  const near = (p, q) => p !== q && p.at.every((v, i) => v.distanceTo(q.at[i]) < 0.01 * run.size);
  return {joints, ends, near, all: joints.concat(ends)};
}

/* paint(kind): the material of a body, the platform, the base or a joint. */
function makeBodies(run, robot, paint) {
  const {joints, all, near} = robot.meet, size = run.size;
  return run.bodies.map((b, index) => {
    const material = paint(b.base ? "base" : b.platform ? "platform" : "body"), group = new THREE.Group(), box = [];
    const add = (mesh) => { mesh.castShadow = mesh.receiveShadow = true; group.add(mesh); };
    group.matrixAutoUpdate = false;
    for (const [p, q] of b.base ? [] : b.rods) add(rod(p, q, b.radius, material));
    if (b.plate && !b.base) add(plate(b.plate.outline, b.plate.normal, 0.9 * b.radius, material));
    if (b.mesh) {
      const g = meshGeometry(b.mesh);
      add(new THREE.Mesh(g, material));
      g.computeBoundingBox();
      const {min, max} = g.boundingBox;
      for (const x of [min.x, max.x]) for (const y of [min.y, max.y]) for (const z of [min.z, max.z]) box.push(V(x, y, z));
    } else if (b.base) group.add(...baseMarkers(b, run, size, material));
    robot.root.add(group);
    if (b.base) robot.besides.push(group);
    const body = {data: b, group, box, matrix: new THREE.Matrix4()};
    if (b.mesh || b.frame || (b.base && b.walled)) return body;
    const lone = b.points.length === 1 && !b.base;  // on something else, which has its own ball
    const elsewhere = (j) => j.body === b && all.some((o) => o.body !== b && near(o, j));
    if (lone && joints.some(elsewhere)) return body;
    const radius = Math.min(1.25 * b.radius, 0.018 * size) + (b.rods.length && b.radius > 0.014 * size ? b.radius - 0.014 * size : 0);
    for (const p of b.points) robot.balls.push({...ball(robot, radius, paint), p: V(...p), body: index});
    return body;
  });
}
function ball(robot, radius, paint) {
  const mesh = new THREE.Mesh(ballGeometry, paint("joint"));
  mesh.scale.setScalar(radius);
  mesh.castShadow = true;
  robot.root.add(mesh);
  robot.besides.push(mesh);
  return {ball: mesh};
}
/* Balls where a link meets something; none at a free end. */
function linkBalls(run, robot, paint) {
  const {ends, all, near} = robot.meet, size = run.size;
  for (const [n, k] of robot.links.entries()) for (const e of [0, 1]) {
    if (k.meshed || !all.some((o) => near(o, ends[2 * n + e]))) continue;
    robot.balls.push({...ball(robot, Math.max(0.0085 * size, 1.05 * Math.min(k.half, 0.012 * size)), paint), link: k, end: e});
  }
}

/* Thin lines from where legs slide out to what slides: no gap opens between the two. */
function makeStems(run, robot, paint) {
  return run.bodies.flatMap((b, index) => b.stems.flatMap(([start, name]) => {
    const body = robot.bodies.find((o) => o.data.name === name), link = robot.links.find((k) => k.data.name === name);
    if (!body && !link) return [];
    const sweep = new Sweep(circle(0.004 * run.size, 8), 2, paint("joint"));
    robot.root.add(sweep.mesh);
    return [{sweep, c: new Float32Array(6), start: V(...start), on: robot.bodies[index], body, link}];
  }));
}

/* A robot as drawn; `besides` is what a ghost shows only beside the other, since it hardly moves. */
function makeRobot(run, links, paint) {
  const robot = {run, root: new THREE.Group(), besides: [], balls: [], notes: [], meet: meetings(run)};
  robot.links = makeLinks(run, robot.root, links, robot.notes);
  robot.bodies = makeBodies(run, robot, paint);
  linkBalls(run, robot, paint);
  robot.stems = makeStems(run, robot, paint);
  return robot;
}
