/* table.js: a table of the curves: each with its value at the instant shown, and a box that hides it. */
let cells = [];                                    // {cell, y}: of which the value follows the time

function openTable() {
  const panel = $("table"), open = S.table && R.plots.length > 0, was = !panel.hidden, id = document.activeElement?.id;
  panel.hidden = !open;
  document.body.classList.toggle("tabled", open);
  cells = [];
  panel.replaceChildren(...(open ? [tableHead(), ...plotList().map(tableOf)] : []));
  if (id && open) $(id)?.focus({preventScroll: true});   // of a box just ticked
  if (was !== open) layoutChanged();
  moveTable(instant(S.t));
}
function tableHead() {
  const part = S.zoom ? `, ${S.zoom.map((t) => digits(t)).join(" to ")} s shown` : "";
  return el("header", {}, el("h2", {}, "Curves"), el("div", {class: "tools"},
    button("zoom in", () => zoomBy(0.5), {id: "zoom-in", title: "all plots, about the instant shown"}),
    button("whole run", () => set({zoom: null}), {id: "whole", disabled: !S.zoom}),
    button("✕", () => { set({table: false}); $("pane").focus({preventScroll: true}); }, {"aria-label": "close table", id: "table-close"})),
    el("p", {}, el("span", {id: "table-time"}), part));
}
function tableOf(p, n) {
  const own = p.curves.filter((c) => !c.rigid), other = p.curves.some((c) => c.rigid);
  const cell = (y) => { const td = el("td"); if (y) cells.push({cell: td, y}); return td; };
  const most = (y) => { let m = 0; for (const v of y) if (Math.abs(v) > Math.abs(m)) m = v; return m; };
  const rows = own.map((c, i) => el("tr", {}, el("th", {scope: "row"}, el("label", {class: "check"},
      el("input", {type: "checkbox", id: `curve-${n}-${i}`, checked: !S.hide.includes(c.name), onchange: () => flip(c.name)}), el("i", {style: `background: ${series(c.colour)}`}), el("span", {}, c.name))),
    cell(c.y), other ? cell(p.curves.find((d) => d.rigid && d.name === c.name)?.y) : null, el("td", {}, minus(digits(most(c.y))))));
  const head = ["now", ...(other ? [otherName()] : []), "largest"].map((text) => el("th", {scope: "col"}, text));
  return el("table", {}, el("caption", {}, p.title, el("span", {class: "unit"}, ` [${p.unit}]`)), el("thead", {}, el("tr", {}, el("td"), ...head)), el("tbody", {}, ...rows));
}
function moveTable(at) {
  if (!cells.length) return;
  $("table-time").textContent = `t = ${clock(S.t)}`;
  for (const {cell, y} of cells) cell.textContent = minus(digits(mixed(y, at)));
}
