/* chart.js: one small plot: axes, curves, a cursor, and a place for values. */
const LEFT = 42, RIGHT = 8, LOW = 16, HIGH = 5;    // [px] about the axes

class Chart {
  /* x: [first, last]; y: [lowest, highest]; xUnit: behind the last number; pick: called with x on a click or drag */
  constructor(host, {title, unit, x, y, xUnit, names, pick, label}) {
    this.values = el("span", {class: "values"});
    this.figure = el("figure", {}, el("figcaption", {}, el("b", {}, title, el("span", {class: "unit"}, ` [${unit}]`)), this.values, names));
    host.append(this.figure);
    this.spec = {x, y, xUnit, pick, label: label || `${title} in ${unit}`};
  }
  draw() {                                         // once its place in the page is known
    const {x, xUnit, pick, label} = this.spec, [a, b] = this.spec.y, box = this.figure;
    const w = this.w = Math.max(box.clientWidth - 12, 60), h = this.h = Math.max(box.clientHeight - box.firstChild.offsetHeight - 8, 40);
    const svg = this.svg = el("svg", {role: "img", "aria-label": label, viewBox: `0 0 ${w} ${h}`, width: w, height: h});
    const low = Math.min(a, 0), top = Math.max(b, 0) > low ? Math.max(b, 0) : low + 1, step = nice((top - low) / (h < 70 ? 2 : 3.2));
    this.low = Math.floor(low / step + 1e-6) * step; this.top = Math.ceil(top / step - 1e-6) * step;
    for (let y = this.low; y <= this.top + step / 2; y += step) svg.append(
      el("line", {x1: LEFT, x2: w - RIGHT, y1: this.Y(y), y2: this.Y(y), class: Math.abs(y) < step / 2 ? "axis zero" : "axis"}),
      el("text", {x: LEFT - 5, y: this.Y(y) + 4, "text-anchor": "end"}, minus(+(Math.round(y / step) * step).toPrecision(6))));
    const dx = [1, 2, 5, 10].map((n) => n * nice((x[1] - x[0]) / 10 || 1)).find((d) => this.X(x[0] + d) - LEFT > 46) || x[1] - x[0];
    const ticks = [];
    for (let v = Math.ceil(x[0] / dx - 1e-6) * dx; v <= x[1] + dx / 1e3; v += dx) ticks.push(v);
    ticks.forEach((v, i) => {
      const last = i === ticks.length - 1, words = `${minus(+v.toPrecision(6))}${last ? " " + xUnit : ""}`, end = last && this.X(v) + 3 * words.length > w;
      svg.append(el("text", {x: end ? w : this.X(v), y: h - 3, "text-anchor": end ? "end" : "middle"}, words));
    });
    if (pick) {
      const drag = (e) => { if (e.type === "pointerdown" || e.buttons) pick(clamp(x[0] + (x[1] - x[0]) * (e.clientX - svg.getBoundingClientRect().left - LEFT) / (w - LEFT - RIGHT), ...x)); };
      svg.addEventListener("pointerdown", drag); svg.addEventListener("pointermove", drag);
      svg.classList.add("picks");
    }
    this.cursor = el("line", {y1: 3, y2: h - LOW, class: "cursor"});
    svg.append(this.cursor);
    box.append(svg);
    return this;
  }
  X(x) { const [a, b] = this.spec.x; return LEFT + (this.w - LEFT - RIGHT) * (x - a) / (b - a || 1); }
  Y(y) { return this.h - LOW - (this.h - LOW - HIGH) * (y - this.low) / (this.top - this.low || 1); }
  add(kind, colour) {
    const path = el("path", {class: kind, style: colour === undefined ? "" : `--colour: ${series(colour)}`});
    this.svg.insertBefore(path, this.cursor);
    return path;
  }
  way(xs, ys) {
    let d = "";
    for (let i = 0; i < xs.length; i++) d += (i ? "L" : "M") + this.X(xs[i]).toFixed(1) + " " + this.Y(ys[i]).toFixed(1);
    return d;
  }
  at(x) { const p = this.X(x).toFixed(3); this.cursor.setAttribute("x1", p); this.cursor.setAttribute("x2", p); }
}
const rangeOf = (...arrays) => { let a = 0, b = 0; for (const y of arrays) for (const v of y) { if (v < a) a = v; if (v > b) b = v; } return [a, b]; };
