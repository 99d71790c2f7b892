/* chart.js: one small plot: axes, curves, a cursor, and a place for values. */
const LEFT = 42, RIGHT = 8, LOW = 16, HIGH = 5;    // [px] about the axes

class Chart {
  /* x: [first, last]; y: [lowest, highest]; close: y without zero; xUnit: behind the last number; pick: called with x on a
     click or drag; zoom: with the ends of a range, or null for all of it */
  constructor(host, {title, unit, x, y, close, xUnit, names, pick, zoom, label}) {
    this.values = el("span", {class: "values"});
    this.figure = el("figure", {}, el("figcaption", {}, el("b", {}, title, el("span", {class: "unit"}, ` [${unit}]`)), this.values, names));
    host.append(this.figure);
    this.spec = {x, y, close, xUnit, pick, zoom, label: label || `${title} in ${unit}`};
  }
  measure() {                                      // once its place in the page is known
    const box = this.figure;
    this.w = Math.max(box.clientWidth - 12, 60);
    this.h = Math.max(box.clientHeight - box.firstChild.offsetHeight - 8, 40);
    return this;
  }
  draw() {
    const {x, xUnit, pick, zoom, close, label} = this.spec, [a, b] = this.spec.y, {w, h} = this;
    this.svg?.remove();
    const svg = this.svg = el("svg", {role: "img", "aria-label": label, viewBox: `0 0 ${w} ${h}`, width: w, height: h});
    const low = close && a < b ? a : Math.min(a, 0), high = close && a < b ? b : Math.max(b, 0), top = high > low ? high : low + 1;
    let step = nice((top - low) / (h < 70 ? 2 : 3.2));
    while ((Math.ceil(top / step - 1e-6) - Math.floor(low / step + 1e-6)) * 14 > h - LOW - HIGH) step = nice(1.5 * step, true);   // [px] a line of text
    this.low = Math.floor(low / step + 1e-6) * step; this.top = Math.ceil(top / step - 1e-6) * step;
    for (let y = this.low; y <= this.top + step / 2; y += step) svg.append(
      el("line", {x1: LEFT, x2: w - RIGHT, y1: this.Y(y), y2: this.Y(y), class: Math.abs(y) < step / 2 ? "axis zero" : "axis"}),
      el("text", {x: LEFT - 5, y: this.Y(y) + 4, "text-anchor": "end"}, minus(+(Math.round(y / step) * step).toPrecision(6))));
    const dx = [1, 2, 5, 10].map((n) => n * nice((x[1] - x[0]) / 10 || 1)).find((d) => this.X(x[0] + d) - LEFT > 46) || x[1] - x[0];
    const ticks = [];
    for (let v = Math.ceil(x[0] / dx - 1e-6) * dx; v <= x[1] + dx / 1e3; v += dx) ticks.push(v);
    ticks.forEach((v, i) => {
      const last = i === ticks.length - 1, words = `${minus(+v.toPrecision(6))}${last ? " " + xUnit : ""}`, wide = 3 * words.length;
      const [at, anchor] = last && this.X(v) + wide > w ? [w, "end"] : this.X(v) - wide < LEFT - 7 ? [LEFT - 3, "start"] : [this.X(v), "middle"];   // not below the numbers of y
      svg.append(el("text", {x: at, y: h - 3, "text-anchor": anchor}, words));
    });
    if (pick) {
      const drag = (e) => { if (e.type === "pointerdown" || e.buttons) pick(this.under(e)); };
      if (zoom) zoomable(this);
      else { svg.addEventListener("pointerdown", drag); svg.addEventListener("pointermove", drag); }
      svg.classList.add("picks");
    }
    this.cursor = el("line", {y1: 3, y2: h - LOW, class: "cursor"});
    svg.append(this.cursor);
    this.figure.append(svg);
    return this;
  }
  under(e) {                                       // x below the pointer
    const [a, b] = this.spec.x;
    return clamp(a + (b - a) * (e.clientX - this.svg.getBoundingClientRect().left - LEFT) / (this.w - LEFT - RIGHT), a, b);
  }
  X(x) { const [a, b] = this.spec.x; return LEFT + (this.w - LEFT - RIGHT) * (x - a) / (b - a || 1); }
  Y(y) { return this.h - LOW - (this.h - LOW - HIGH) * (y - this.low) / (this.top - this.low || 1); }
  add(kind, colour) {
    const path = el("path", {class: kind, style: colour === undefined ? "" : `--colour: ${series(colour)}`});
    this.svg.insertBefore(path, this.cursor);
    return path;
  }
  mark({t, name, colour, own}) {                   // an instant of a run; that of the run shown is the bold one
    const [a, b] = this.spec.x;
    if (t < a || t > b) return;
    const line = el("line", {x1: this.X(t), x2: this.X(t), y1: 3, y2: this.h - LOW, class: own ? "instant own" : "instant", style: `--colour: ${series(colour)}`});
    const words = document.createElementNS("http://www.w3.org/2000/svg", "title");
    words.textContent = name;
    line.append(words);
    this.svg.insertBefore(line, this.cursor);
  }
  way(xs, ys) {
    let d = "";
    for (let i = 0; i < xs.length; i++) d += (i ? "L" : "M") + this.X(xs[i]).toFixed(1) + " " + this.Y(ys[i]).toFixed(1);
    return d;
  }
  at(x) {                                          // the cursor, unless it is beyond the range shown
    const [a, b] = this.spec.x, slack = 1e-6 * (b - a);
    this.cursor.style.transform = `translateX(${this.X(x).toFixed(3)}px)`;   // a layer of its own: nothing below it is drawn again
    this.cursor.classList.toggle("out", x < a - slack || x > b + slack);
  }
}
const rangeOf = (...arrays) => {
  let a = Infinity, b = -Infinity;
  for (const y of arrays) for (const v of y) { if (v < a) a = v; if (v > b) b = v; }
  return a > b ? [0, 0] : [a, b];
};
