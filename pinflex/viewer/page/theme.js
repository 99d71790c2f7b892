/* theme.js: light or dark as the system has it, or as asked; colours of the drawing follow the style sheet. */
const system = matchMedia("(prefers-color-scheme: dark)");
const isDark = () => S.theme === "dark" || (S.theme === "auto" && system.matches);
const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const SERIES = 8;                                  // colours of curves in the style sheet
const series = (i) => `var(--c${i % SERIES})`;

/* A material of a colour of the style sheet, as its key in the legend. */
const themed = [];
function inTheme(material, name) {
  themed.push([material, name]);
  material.color.set(style(name));
  return material;
}

let shown = null;
function applyTheme() {
  const name = isDark() ? "dark" : "light";
  if (shown === name) return;
  shown = name;
  document.documentElement.dataset.theme = name;
  viewer.tints = ["--haze", "--sky"].map((name) => viewer.scene.fog.color.clone().set(style(name)));
  viewer.scene.fog.color.set(style("--fog"));
  for (const [material, name] of themed) material.color.set(style(name));
  if (R) { relight(); chooseGhost(); setColours(); }
  viewer.dirty();
}
system.addEventListener("change", applyTheme);
