/* names.js: curves by their names: a click hides one and shows it again, in every plot. */
const OTHERS = "--";                               // stands for the curves of what the run is compared with
const isShown = (c) => !S.hide.includes(c.rigid ? OTHERS : c.name) && !(c.rigid && S.hide.includes(c.name));
function flip(name) { set({hide: S.hide.includes(name) ? S.hide.filter((n) => n !== name) : [...S.hide, name]}); }
function nameButton(name, text, colour) {
  const on = !S.hide.includes(name), whole = name === OTHERS ? otherName() : name;
  return button(text, () => flip(name), {class: name === OTHERS ? "name dash" : "name", "aria-pressed": String(on), "data-name": name, title: `${on ? "hide" : "show"} ${whole}`,
    style: colour === undefined ? null : `color: ${series(colour)}`});
}

/* Names of a plot's curves: before their values where there is room, without what all have in common
   where there is less, in a line of their own where there is little, without values where those do not fit either.
   Returns the places of the values (null: none) and the line (null: none). */
function caption(p, width) {
  const some = p.curves.filter((c) => !c.rigid).slice(0, SERIES), full = some.map((c) => c.name), short = some.length < 2 ? full : shortened(full);
  const value = (c) => el("span", {style: `color: ${series(c.colour)}`, title: c.name}), values = some.map(value);
  const dash = p.curves.some((c) => c.rigid) ? [nameButton(OTHERS, `┄ ${otherName()}`)] : [];
  const more = p.curves.filter((c) => !c.rigid).length - some.length;
  if (more > 0) dash.push(button(`+ ${more}`, () => set({table: true}), {class: "name", "aria-label": `${more} more curves of ${p.title}`}));
  const line = (...parts) => parts.length ? el("span", {class: "names"}, ...parts) : null;
  if (some.length < 2) return {values, shown: values, line: line(...dash)};
  const longest = (y) => { let n = 0; for (let i = 0; i < y.length; i += 1 + (y.length >> 6)) n = Math.max(n, digits(y[i]).length); return n; };
  const widths = some.reduce((n, c) => n + longest(c.y) + 2.5, 0);   // of the whole run: nothing jumps as it plays
  const room = width / 6.6 - p.title.length - p.unit.length - 6, fits = (names) => names.join("").length + widths < room;
  const names = [full, short].find(fits), buttons = some.map((c, i) => nameButton(c.name, (names || short)[i], c.colour));
  if (names) return {values, shown: buttons.map((b, i) => { b.append(" ", values[i]); return b; }), line: line(...dash)};
  return {values: 0.9 * widths < room ? values : null, shown: 0.9 * widths < room ? values : [], line: line(...dash, ...buttons)};
}
function shortened(full) {
  const common = (names) => { let n = 0; while (names.every((s) => n < s.length && s[n] === names[0][n])) n++; return n; };
  const start = full[0].slice(0, common(full)).match(/^.*[_\W]/) || [""], back = (s) => [...s].reverse().join("");
  const tail = full[0].slice(full[0].length - common(full.map(back))).match(/[_\W].*$/) || [""];
  const brief = full.map((s) => s.slice(start[0].length, s.length - tail[0].length));
  return brief.every((s) => /[a-z]/i.test(s)) ? brief : full;
}
