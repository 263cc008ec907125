// What the theme adds to a page in the browser: the keyboard can scroll wide tables, and buttons over code have a name.
document$.subscribe(() => {
  for (const table of document.querySelectorAll(".md-typeset__scrollwrap")) table.tabIndex = 0;
  document.querySelectorAll(".md-code__nav").forEach((nav, index) => {
    nav.ariaLabel = `Code ${index + 1}`;
  });
});
