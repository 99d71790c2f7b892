/* layout.js: the page as elements, before anything is drawn. */
const check = (key, text, label) => el("label", {class: "check", title: label || text},
  el("input", {type: "checkbox", id: "opt-" + key, onchange: (e) => set({[key]: e.target.checked})}), text);
const select = (id, label, options, onchange) => el("select", {id, "aria-label": label, onchange},
  ...options.map(([v, text]) => el("option", {value: v}, text)));
const button = (text, onclick, more) => el("button", {type: "button", onclick, ...more}, text);
const positive = (id, key, more) => el("input", {id, type: "number", step: "any", min: "0", ...more,
  onchange: (e) => set({[key]: parseFloat(e.target.value) > 0 ? parseFloat(e.target.value) : null})});
const SPEEDS = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5], FEW = 5;

function runLabel(r, i) {
  if (r.mode) return `mode ${i + 1} · ${digits(r.mode.frequency, 4)} Hz`;
  return r.label || r.key || r.level;
}

/* Few runs side by side, as radio buttons; many in a list. */
function runPicker() {
  const names = DATA.runs.map(runLabel);
  if (names.length < 2) return null;
  if (names.length > FEW || DATA.runs[0].mode) return select("run", "run", names.map((n, i) => [i, n]), (e) => show(+e.target.value));
  return el("div", {id: "levels", class: "segments", role: "radiogroup", "aria-label": "level shown"}, ...names.map((n, i) =>
    el("label", {}, el("input", {type: "radio", name: "level", value: i, onchange: () => show(i)}), el("span", {}, n))));
}

/* What the run is compared with; in the heading, as the views are in the corner: on a small window both are in the menu Display. */
function against() {
  return el("div", {id: "against"},
    el("span", {class: "soft"}, "against "),
    select("other", "compared with", [], (e) => set({other: e.target.value})),
    select("ghost", "how it is shown", [["over", "overlaid"], ["beside", "side by side"], ["off", "hidden"]], (e) => set({ghost: e.target.value})),
    check("diff", "difference", "plots and colours show the difference"));
}
const small = matchMedia("(max-width: 620px), (max-height: 480px)");
function arrange() {
  const panel = $("options").querySelector(".grid"), views = $("views");
  if (small.matches) panel.prepend(views, $("against"));
  else { $("readout").before($("against")); $("compass").prepend(views); }
}
small.addEventListener("change", arrange);

function head() {
  return el("header", {id: "head"},
    el("h1", {}, DATA.title),
    runPicker(),
    el("p", {id: "sub"}),
    against(),
    el("p", {id: "readout"}),
    el("div", {id: "chips", role: "group", "aria-label": "verdicts"}));
}

function legend() {
  return el("section", {id: "legend", "aria-label": "colour legend"},
    el("div", {id: "legend-title"}, select("field", "coloured by", [], (e) => set({field: e.target.value, max: null})), el("span", {id: "unit"})),
    el("div", {id: "scale"}, el("div", {id: "bar"}), el("div", {id: "ticks"})),
    el("div", {id: "keys"}));
}

function exportMenu() {
  return el("details", {id: "export", class: "menu"},
    el("summary", {}, "Export"),
    el("div", {class: "list"},
      button("Picture (PNG)", savePicture, {title: "this instant, with its legend"}),
      button("Film (video)", film, {id: "film", title: "one pass through the motion at the speed chosen, with its legend: WebM, or MP4 where the browser records that"}),
      button("Curves (CSV)", saveCurves, {title: "all plots over time"}),
      button("Copy link", copyLink, {id: "copy", hidden: location.protocol === "about:", title: "address of this page that shows just this"})));
}

function displayMenu() {
  return el("details", {id: "options", class: "menu"},
    el("summary", {}, "Display"),
    el("div", {class: "panel"}, el("div", {class: "grid"},
      check("colours", "colours"), check("peak", "peak marker"), check("names", "link names"), check("plots", "plots"),
      check("table", "table of curves"), check("shadow", "shadows", "soft shadows; off at first where the browser draws without a graphics processor: there they cost a third to a half of its speed"),
      check("force", "joint forces"), check("torque", "motor torques"), check("loop", "loop"), button("full screen", fullScreen, {id: "full", hidden: !document.fullscreenEnabled}),
      el("label", {class: "wide"}, "diagrams of ", select("link", "diagrams of link", [], (e) => set({link: e.target.value || null, at: null}))),
      el("label", {class: "wide"}, "path ", select("path", "path", [["true", "true scale"], ["magnified", "magnified"], ["off", "hidden"]],
        (e) => set({path: e.target.value}))),
      el("label", {class: "wide"}, "colour map ", select("map", "colour map", [["viridis", "viridis"], ["cividis", "cividis"], ["turbo", "turbo"]],
        (e) => set({map: e.target.value}))),
      el("label", {class: "wide"}, "theme ", select("theme", "theme", [["auto", "as the system"], ["light", "light"], ["dark", "dark"]],
        (e) => set({theme: e.target.value}))),
      el("div", {class: "wide"}, el("label", {for: "max"}, "maximum"), positive("max", "max"),
        button("auto", () => set({max: null}), {title: "largest value of the run"})),
      el("label", {class: "wide", title: "material limit: above it the colour changes"}, "limit ", positive("limit", "limit", {placeholder: "none"}))),
    el("p", {id: "notes"}),
    el("p", {class: "help"}, "space play · ← → frame (shift: 10) · home end · + − magnify · w worst · 1–9 level · d difference · g rigid · l link · t table of curves · z Z zoom the plots, all of the run · n names · f forces · esc close")));
}

function compass() {
  const views = [["fit", "Fit", "fit the robot into the window"], ["iso", "Iso", "view from above a corner"], ["front", "Front", "view along y"],
    ["side", "Side", "view along −x"], ["top", "Top", "view from above"]];
  return el("div", {id: "compass"},
    el("div", {id: "views", class: "segments", role: "group", "aria-label": "view"}, ...views.map(([k, text, title]) => button(text, () => look(k), {id: "view-" + k, title}))),
    el("div", {id: "triad", "aria-hidden": "true"}),
    el("div", {id: "ruler", title: "length at the middle of the robot"}, el("span", {})));
}

function dock() {
  return el("footer", {id: "dock"},
    el("div", {id: "controls"},
      el("button", {id: "play", type: "button", "aria-label": "play", onclick: () => set({play: !S.play})}),
      el("input", {id: "time", type: "range", min: 0, max: 1, step: "any", "aria-label": "time", oninput: (e) => seek(+e.target.value)}),
      el("output", {id: "clock", for: "time"}),
      el("label", {id: "speed-box"}, el("span", {}, "speed"), select("speed", "speed, relative to real time",
        SPEEDS.map((s) => [s, "×" + s]), (e) => set({speed: +e.target.value}))),
      el("span", {id: "mag-box"}, el("span", {}, "deflection"),
        el("input", {id: "mag", type: "range", min: 0, step: 1, "aria-label": "magnification of deflections", oninput: (e) => setMag(scene.steps[+e.target.value])}),
        el("span", {class: "times"}, "×"),
        el("input", {id: "mag-number", type: "number", min: 0, step: "any", "aria-label": "magnification",
          onchange: (e) => setMag(Math.max(0, parseFloat(e.target.value) || 0))})),
      button("worst", worst, {id: "worst", title: "go to the largest value of the run"})),
    el("div", {id: "plots", role: "group", "aria-label": "plots over time", tabindex: "0"}));
}

let headBox = [0, 0, 0, 0];                        // [px] which values at arrows leave free
function buildPage() {
  $("app").append(
    el("main", {id: "stage"},
      el("div", {id: "pane", role: "img", tabindex: "0", "aria-label": DATA.title}),
      el("div", {id: "labels", "aria-hidden": "true"}),
      head(), legend(), compass(),
      el("div", {id: "tools"}, exportMenu(), displayMenu()),
      el("div", {id: "tip", role: "tooltip", hidden: true})),
    el("aside", {id: "beam", class: "side", "aria-label": "link", hidden: true}),
    el("aside", {id: "table", class: "side", "aria-label": "table of curves", tabindex: "0", hidden: true}),
    dock(),
    el("div", {id: "status", class: "unseen", role: "status", "aria-live": "polite"}));
  $("worst").append(el("span", {}, " instant"));
  arrange();
  new ResizeObserver(() => {
    const {offsetLeft: left, offsetTop: top, offsetWidth: width, offsetHeight: height} = $("head");
    headBox = [left, top, left + width, top + height];
    $("stage").style.setProperty("--head", `${top + height}px`);
    place();                                       // clear of it
  }).observe($("head"));
  for (const menu of document.querySelectorAll(".menu")) menu.addEventListener("toggle", () => {   // one at a time
    if (menu.open) for (const other of document.querySelectorAll(".menu")) if (other !== menu) other.open = false;
  });
}
