// What the theme leaves to be done for readers who use keys or a screen reader.
addEventListener("load", () => setTimeout(() => {
  document.querySelector(".md-search")?.setAttribute("aria-label", "Search");
  document.querySelectorAll("pre > code, .md-typeset__scrollwrap").forEach((box) => {
    if (box.scrollWidth > box.clientWidth) box.tabIndex = 0;
  });
  document.querySelectorAll(".md-code__nav").forEach((bar, n) => {
    bar.setAttribute("aria-label", `Code ${n + 1}`);
  });
}, 300));
